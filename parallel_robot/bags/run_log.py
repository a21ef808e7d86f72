"""A bag as time-aligned arrays."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags import command_states, planned_motion
from parallel_robot.bags.bag_reader import Bag
from parallel_robot.bags.bag_view import AS_RECORDED, INSTEAD, BagView
from parallel_robot.bags.command_states import Answers, Used
from parallel_robot.bags.counts import TopicCount, count
from parallel_robot.bags.message_arrays import Samples, ours, physical, strange, whole
from parallel_robot.bags.span import WHOLE, Span
from parallel_robot.bags.state_doubts import LEAP, beyond, doubts, flipped, leaping, too_strong
from parallel_robot_control.contract import JointReference
from parallel_robot_control.extrapolation import extrapolate_rows
from parallel_robot_control.state_rhythm import StateRhythm
from parallel_robot_model.common.errors import BagError, WholeNeededError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.units import NANOSECONDS, JointUnits
from parallel_robot_model.configuration.loop import SWAPPED, LoopParameters
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import RECORDED, Topic
from parallel_robot_model.robots.configuration import units_of
from parallel_robot_sim.imperfections import reported_age

FEW = 5  # topics of a bag that are named
FEW_LEAPS = 0.2  # of the states, which may be of another publisher
EMPTY = np.zeros((0, 0))
NO_REFERENCE = 'have no reference of their time'
NEEDED = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
REFERENCE_FIELDS = ('position', 'velocity', 'acceleration')


class RunLog(NamedTuple):
    """A recorded run with one row for each state, the reference at the stamp of the state.

    Attributes:
        scenario: Name of the scenario.
        law: Name of the law.
        joints: Names of the actuated joints.
        config: The resolved configuration.
        start_stamp: Stamp of t = 0 [ns].
        stamps: Stamps of the states [ns], shape (N,).
        time: Stamps since t = 0 [s], shape (N,).
        position: Measured actuated angles [rad], shape (N, n).
        velocity: Measured actuated rates, NaN where the bag has none [rad/s], shape (N, n).
        effort: Torques applied during the step that ended at the stamp; those commanded where the
            bag has none [N m], shape (N, n).
        reference_position: Desired angles [rad], shape (N, n).
        reference_velocity: Desired rates [rad/s], shape (N, n).
        reference_acceleration: Desired accelerations [rad/s^2], shape (N, n).
        command: Commanded torques in the order of the messages [N m], shape (M, n).
        messages: Counts per topic, by name without leading slash.
        answer: Command that answered each state [N m], NaN where there is none, shape (N, n).
        heard: Log times of the states [ns], shape (N,).
        answers: The commands with the states that they answer; None where the bag does not say.
        used: References that the controller used; None in bags that do not say.
        has_efforts: Whether the torques were measured, as far as the robot does.
        warnings: What is wrong with the bag, one line each.
        referenced: Whether a state has a reference of its time, as the controller sees it; without
            one it has no error, shape (N,).
        foreign: Whether the bag does not say of which robot it is: nothing is written into it
            that nobody asked for.
    """

    scenario: str
    law: str
    joints: tuple[str, ...]
    config: dict[str, Any]
    start_stamp: int
    stamps: np.ndarray
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    reference_position: np.ndarray
    reference_velocity: np.ndarray
    reference_acceleration: np.ndarray
    command: np.ndarray
    messages: dict[str, TopicCount]
    answer: np.ndarray = EMPTY
    heard: np.ndarray = EMPTY
    answers: Answers | None = None
    used: Used | None = None
    has_efforts: bool = True
    warnings: tuple[str, ...] = ()
    referenced: np.ndarray = EMPTY
    foreign: bool = False

    @property
    def units(self) -> JointUnits:
        """Units of the joints, those of hinges where the robot is not known."""
        return units_of(self.config)

    @property
    def values(self) -> dict[str, Any]:
        """The resolved configuration, as a run of the notebook calls it."""
        return self.config

    @property
    def has_velocities(self) -> bool:
        """Whether the rates of the joints were measured."""
        return not np.isnan(self.velocity).any()

    @property
    def kind(self) -> tuple[bool, bool, bool]:
        """Whether it has efforts, velocities, and the references that were used."""
        return self.has_efforts, self.has_velocities, self.used is not None


def of(
    bag: Path,
    found: Bag[list[Samples]],
    streams: Mapping[Topic, list[Samples]],
    settings: tuple[dict[str, Any], LoopParameters, int],
    view: BagView = AS_RECORDED,
    span: Span = WHOLE,
) -> RunLog:
    """The run of a bag, or a part of it.

    Args:
        bag: The bag, for error messages.
        found: What was read of it.
        streams: Its messages, see :func:`streams_of`.
        settings: See :func:`experiment.configuration`.
        view: What it does not say itself.
        span: The part; messages around it are there, too.

    Raises:
        BagError: it is not of a run, or a topic that the log needs is not in it.
    """
    streams, view = dict(streams), view.of(bool(found.metadata))
    for needed in NEEDED:
        if needed not in streams:
            raise BagError(f'{bag} has no messages on {wanted(needed, streams, found)}')
    values, loop, start = settings
    warnings = [*found.warnings]
    for topic in (topics.JOINT_STATES, topics.REFERENCE):
        streams[topic], remarks = ours(topic, streams[topic], loop.joints)
        warnings += [f'{bag}: {remark}' for remark in remarks]
    streams[topics.REFERENCE], held = planned_motion.cut(streams[topics.REFERENCE])
    if not streams[topics.REFERENCE]:
        raise BagError(
            f'{bag}: {topics.REFERENCE.name} is not understood: no trajectory has points'
        )
    if held:
        what = f'{held} messages on {topics.REFERENCE.name} have no velocities'
        warnings.append(f'{bag}: {what}: each counts as it is until the next')
    states, references, commands = (
        whole(bag, topic, streams[topic], loop.joints)
        for topic in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
    )
    states = _physical(bag, topics.JOINT_STATES, states, warnings)
    references = _physical(bag, topics.REFERENCE, references, warnings)
    states = _ordered(bag, topics.JOINT_STATES, states, warnings)
    references = _ordered(bag, topics.REFERENCE, references, warnings)
    if not found.metadata:
        states = _alone(bag, states, warnings, units_of(values))
    if 'velocity' not in states.numbers:
        states.numbers['velocity'] = np.full_like(states.numbers['position'], np.nan)
        warnings.append(f'{bag}: the messages on {topics.JOINT_STATES.name} have no velocities')
    has_efforts = 'effort' in states.numbers
    if not has_efforts:
        what = f'the messages on {topics.JOINT_STATES.name} have no efforts'
        warnings.append(f'{bag}: {what}: torques are those commanded')
    recorded = command_states.recorded(streams.get(topics.ANSWERED, []), commands)
    commands.numbers['data'][~physical(commands)] = np.nan  # as if there were none
    if not start and span == WHOLE:  # of a part it is known
        start = int(max(states.stamps[0], references.stamps[0]))
    age = reported_age(values)
    used = (states.stamps + age >= start) & (states.stamps + age >= references.stamps[0])
    if not used.any():
        raise BagError(f'{bag}: no state has a reference at or before its stamp')
    stamps = states.stamps[used]
    if len(stamps) > 1 and not (stamps[-1] > stamps[0] and np.median(np.diff(stamps)) > 0.0):
        raise BagError(f'{bag}: the stamps of {topics.JOINT_STATES.name} do not increase')
    repeated = int((np.diff(np.sort(stamps)) == 0).sum())
    if repeated:
        what = f'{repeated} messages on {topics.JOINT_STATES.name} repeat a stamp'
        warnings.append(f'{bag}: {what}: the motion was reset, or had two publishers')
    position = states.numbers['position'][used]
    part: slice | np.ndarray = slice(None)
    if (view.start, view.stop) != (None, None):
        part = _within((stamps - start) / NANOSECONDS, view.start, view.stop)
    units = units_of(values)
    desired = reference_at(
        stamps, references.stamps, *(references.numbers[name] for name in REFERENCE_FIELDS)
    )
    told = doubts(bag, stamps[part], position[part], units)
    if not found.metadata:  # units and signs of the suite are known
        told += beyond(position[part], units)
        told += flipped(loop.joints, position[part], desired[0][part], units)
        if has_efforts:
            strongest = np.asarray(values.get('plant.torque_limit', np.inf), np.float64)
            told += too_strong(states.numbers['effort'][used][part], strongest, units)
    warnings += [f'{bag}: {doubt}' for doubt in told]
    rhythm = StateRhythm(loop.period_ns)
    rhythm.note(stamps)
    rhythm.look()
    if found.metadata and rhythm.doubt and not loop.lockstep:
        warnings.append(f'{bag}: {rhythm.doubt}')
    limit = _reference_timeout(values, references.stamps)
    referenced = newest_age(stamps + age, references.stamps) <= limit
    if span == WHOLE and not referenced.all():
        text = _unreferenced(stamps, start, references.stamps, referenced)
        warnings.append(f'{bag}: {text}')
    assumed = _assumed(values, loop.joints, bool(found.metadata), view)
    if assumed:
        warnings.append(f'{bag} {assumed}')
    answer, answers, in_use = _answers(
        stamps, states, references, commands, recorded, span == WHOLE
    )
    states_period = loop.period_ns if loop.lockstep else rhythm.period
    run = RunLog(
        loop.scenario if found.metadata or view.assumes else 'unknown',
        loop.law if found.metadata or view.assumes else 'unknown',
        loop.joints,
        values,
        start,
        stamps,
        (stamps - start) / NANOSECONDS,
        position,
        states.numbers['velocity'][used],
        states.numbers['effort'][used] if has_efforts else _commanded(answer),
        *desired,
        commands.numbers['data'],
        count(streams, loop.period_ns, recorded, states_period, span),
        answer,
        states.log_times[used],
        answers,
        in_use,
        has_efforts,
        tuple(warnings),
        referenced,
        not found.metadata,
    )
    if span == WHOLE:
        return run
    return rows(run, np.flatnonzero((run.stamps >= span.begin) & (run.stamps < span.end)))


def wanted(topic: Topic, known: Mapping[Topic, Any], found: Bag[Any]) -> str:
    """A topic that a bag lacks, its type, what may be meant instead, and the option that says so.

    Args:
        topic: The topic.
        known: The topics that the bag has.
        found: What was read of it.
    """
    channels = found.channels
    kinds = {kind.replace('/msg/', '/') for kind in (topic.type, *INSTEAD.get(topic, ()))}
    taken = {other.name for other in known}
    others = [
        (name, other)
        for name, other in channels.items()
        if (other.replace('/msg/', '/') in kinds or name.endswith(f'/{topic.name}'))
        and name.lstrip('/') not in taken
    ]
    what = f'{topic.name} ({topic.type})'
    if not others:
        names = ', '.join(printable(name, 60) for name in [*channels][:FEW])
        names += f' and {len(channels) - FEW} others' if len(channels) > FEW else ''
        needless = '; analyze, export and identify need none' if topic == topics.REFERENCE else ''
        return (
            f'{what}, nor on another topic of that type; it has {names or "no topics"}{needless}'
        )
    shown = ', '.join(
        f'{printable(name, 60)} ({printable(other, 60)})'
        if name not in found.encodings
        else f'{printable(name, 60)} ({printable(other, 60)} as {found.encodings[name]:.20})'
        for name, other in others[:FEW]
    )
    alike = [name for name, other in others if other in (topic.type, *INSTEAD.get(topic, ()))]
    strange = any(name in found.encodings for name, _ in others)
    alike = [name for name in alike if name not in found.encodings]
    if not alike:
        help_text = '; only messages as cdr, of ROS 2, are read' if strange else ''
        return f'{what}; it has {shown}{help_text}'
    word = topic.name.rpartition('/')[2]
    return f'{what}; it has {shown}: --topic {word}={printable(alike[0], 60)} takes it'


def _commanded(answer: np.ndarray) -> np.ndarray:
    """Torques commanded before each state: the last answer to an earlier one, at first zero.

    Args:
        answer: Command that answered each state [N m], NaN where there is none, shape (N, n).
    """
    given = np.vstack([np.zeros((1, answer.shape[1])), answer[:-1]])
    known = np.isfinite(given).all(axis=1)
    return given[np.maximum.accumulate(np.where(known, np.arange(len(given)), 0))]


def _assumed(values: Mapping[str, Any], joints: Sequence[str], known: bool, view: BagView) -> str:
    """What was assumed of a bag that does not say of what it is; empty where nothing was."""
    given = view.told()
    if known:
        return f'is read with {given} in place of what it says itself' if given else ''
    robot = f'{values["robot_model"]} with the parameters of {view.scenario or "the paper"}'
    what = f'does not say of which robot it is: taken to be of {robot}, joints {", ".join(joints)}'
    return f'{what}; given: {given}' if given else f'{what}; --scenario and --set say another'


def between(bag: Path, log: RunLog, start: float | None, stop: float | None) -> RunLog:
    """The states of a part of a run, with all its commands.

    Args:
        bag: The bag, for error messages.
        log: The run.
        start: From which time on [s]; None: from the first state.
        stop: Up to which [s]; None: to the last one.

    Raises:
        BagError: there is no state in it.
    """
    if start is None and stop is None:
        return log
    chosen = _within(log.time, start, stop)
    if not len(chosen):
        raise BagError(no_state(bag, float(log.time.min()), float(log.time.max())))
    return rows(log, chosen)


def no_state(bag: Path, first: float, last: float) -> str:
    """That a part has no state of a bag whose states go from one time to another [s], in words."""
    ends = f'from t = {first:.3f} s to {last:.3f} s'
    return f'{bag} has no state between --from and --to: its states go {ends}'


def _within(time: np.ndarray, start: float | None, stop: float | None) -> np.ndarray:
    """Numbers of the states from one time to another [s]."""
    since, until = (-np.inf if start is None else start), (np.inf if stop is None else stop)
    return np.flatnonzero((time >= since) & (time <= until))


def head(log: RunLog, count: int) -> RunLog:
    """The first states of a run, with all its commands."""
    return rows(log, np.arange(count))


def with_reference(log: RunLog) -> RunLog:
    """The states of a run that have a reference of their time, with all its commands."""
    if log.referenced.all():
        return log
    return rows(log, np.flatnonzero(log.referenced))


def rows(log: RunLog, chosen: np.ndarray) -> RunLog:
    """Some states of a run, by their numbers in order, with all its commands."""
    kept: dict[str, Any] = {
        name: value[chosen]
        for name, value in log._asdict().items()
        if name != 'command' and isinstance(value, np.ndarray) and len(value)
    }
    return log._replace(**kept, used=None if log.used is None else log.used.rows(chosen))


def joined(first: RunLog, second: RunLog) -> RunLog:
    """A part of a run and the next one; with the commands of the next one.

    Raises:
        WholeNeededError: they are of another kind.
    """
    if first.kind != second.kind:
        raise WholeNeededError('the parts of the bag do not hold the same')
    both: dict[str, Any] = {
        name: np.concatenate([value, getattr(second, name)])
        for name, value in first._asdict().items()
        if name != 'command' and isinstance(value, np.ndarray)
    }
    used = second.used
    if first.used is not None and used is not None:
        one = first.used
        used = Used(
            np.concatenate([one.stamps, used.stamps]),
            np.concatenate([one.acts, used.acts]),
            np.concatenate([one.late, used.late]),
            np.concatenate([one.older, len(one.stamps) + used.older]),
            JointReference(*map(np.concatenate, zip(one.samples, used.samples, strict=True))),
        )
    return second._replace(**both, used=used)


def _ordered(bag: Path, topic: Topic, samples: Samples, warnings: list[str]) -> Samples:
    """Put samples into the order of their stamps, with a line in `warnings`.

    States whose stamps begin anew, as in a second run, keep their order.
    """
    back = np.maximum.accumulate(samples.stamps) - samples.stamps
    count = int((back > 0).sum())
    if not count or (topic == topics.JOINT_STATES and back.max() > SWAPPED):
        return samples
    if topic == topics.JOINT_STATES:
        what = f'{count} messages on {topic.name} came after newer ones'
        warnings.append(f'{bag}: {what}; they are put in the order of their stamps')
    order = np.argsort(samples.stamps, kind='stable')
    return samples.rows(order)


def _alone(bag: Path, states: Samples, warnings: list[str], units: JointUnits) -> Samples:
    """Leave out states of another publisher, with a line in `warnings`, where they are few."""
    leaps = leaping(states.numbers['position'])
    count = int(leaps.sum())
    if not 0 < count < FEW_LEAPS * len(leaps):
        return states
    what = f'{count} of {len(leaps)} states leap by more than {LEAP:g} {units.of("rad")} and back'
    warnings.append(f'{bag}: {what}: of another publisher? they are left out')
    return states.rows(~leaps)


def _reference_timeout(values: dict[str, Any], stamps: np.ndarray) -> int:
    """Age at which a reference ends [ns]: that of the controller, at least two periods of it."""
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    return round(max(values['safety.reference_timeout'] * NANOSECONDS, 2.0 * period))


def _unreferenced(
    stamps: np.ndarray, start: int, known: np.ndarray, referenced: np.ndarray
) -> str:
    """What to know of states without a reference of their time."""
    count, first = int((~referenced).sum()), int(np.argmin(referenced))
    time = (stamps[first] - start) / NANOSECONDS
    if referenced.any():
        return unreferenced(count, time)
    behind = float(np.median(stamps) - np.median(known)) / NANOSECONDS
    return (
        'no state has a reference of its time: the stamps of '
        f'{topics.REFERENCE.name} are {behind:.3g} s behind those of {topics.JOINT_STATES.name}: '
        'of another clock'
    )


def unreferenced(count: int, time: float) -> str:
    """That so many states, from a time on [s], have no reference, in words."""
    what = f'{count} states, from t = {time:.3f} s on, {NO_REFERENCE}'
    return f'{what}: they have no error and are left out'


def _physical(bag: Path, topic: Topic, samples: Samples, warnings: list[str]) -> Samples:
    """Leave out samples whose numbers no robot can have, with a line in `warnings`.

    Raises:
        BagError: nothing is left.
    """
    kept = physical(samples)
    count = len(kept) - int(kept.sum())
    if not count:
        return samples
    if count == len(kept):
        what = f'no message on {topic.name} has numbers that a robot can have'
        raise BagError(f'{bag}: {what}: {strange(samples)}')
    what = f'{count} messages on {topic.name} have numbers that no robot can have'
    warnings.append(f'{bag}: {what} ({strange(samples)}); they are left out')
    return samples.rows(kept)


def streams_of(
    bag: Path,
    found: Mapping[str, Sequence[Sequence[Samples]]],
    view: BagView = AS_RECORDED,
) -> dict[Topic, list[Samples]]:
    """Streams of the suite's topics, all in one namespace but for those that were chosen.

    Args:
        bag: The bag, for error messages.
        found: Messages by full name of the topic.
        view: Which topics take the place of others, and which namespace is wanted.

    Raises:
        BagError: those of several robots are there, or none of the one that is wanted.
    """
    spaces: list[str] = []
    for topic in NEEDED:  # the first that is there says where the others are
        end = f'/{topic.name}'
        spaces = [name.removesuffix(end) for name in found if name.endswith(end)]
        if spaces and topic.name not in view.topics:
            break
    if view.namespace is not None and spaces and view.namespace not in spaces:
        there = ', '.join(space or '/' for space in sorted(spaces))
        raise BagError(f'{bag} has nothing in --namespace {view.namespace or "/"}, but in {there}')
    if view.namespace is None and len(spaces) > 1 and '' not in spaces:
        there = ', '.join(sorted(spaces))
        raise BagError(f'{bag} holds several runs, in {there}; --namespace chooses one')
    space = '' if '' in spaces or not spaces else spaces[0]
    space = space if view.namespace is None else view.namespace
    names = {topic: view.topics.get(topic.name, f'{space}/{topic.name}') for topic in RECORDED}
    streams = {topic: found.get(name, []) for topic, name in names.items()}
    return {topic: [*itertools.chain(*parts)] for topic, parts in streams.items() if parts}


def newest_age(stamps: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Age of the newest reference at each state [ns], shape (N,); negative before the first.

    Args:
        stamps: Of the states [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
    """
    age: np.ndarray = stamps - known[_newest(stamps, known)]
    return age


def _newest(stamps: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Number of the newest of some stamps at others, shape (N,); the first before it."""
    return np.maximum(np.searchsorted(known, stamps, side='right') - 1, 0)


def reference_at(
    stamps: np.ndarray,
    known: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> JointReference:
    """Extrapolate references to other stamps, each from the newest before with its derivatives.

    Args:
        stamps: Where they are wanted; before the first known one, it counts [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
        position: Joint angles [rad], shape (M, n).
        velocity: Their rates [rad/s], shape (M, n).
        acceleration: Their accelerations [rad/s^2], shape (M, n).
    """
    newest = _newest(stamps, known)
    return extrapolate_rows(
        stamps - known[newest], position[newest], velocity[newest], acceleration[newest]
    )


def _answers(
    stamps: np.ndarray,
    states: Samples,
    references: Samples,
    commands: Samples,
    recorded: Answers | None,
    whole: bool,
) -> tuple[np.ndarray, Answers | None, Used | None]:
    """Commands of the states with these stamps; see RunLog.answer, answers and used."""
    answers, sure = recorded, True
    if answers is None:
        answers, sure = command_states.guess(states, commands, whole)
    command = command_states.by_state(stamps, answers.states)
    answer = answers.torque[command]
    answer[command < 0] = np.nan
    if recorded is None:
        return answer, answers if sure else None, None
    known = np.where(command < 0, 0, answers.references[command])
    acts = np.where(known > 0, answers.acts[command], stamps)
    return answer, answers, command_states.used(stamps, acts, known, references)
