"""A bag as time-aligned arrays."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags import command_states
from parallel_robot.bags.bag_reader import Bag
from parallel_robot.bags.command_states import Answers, Used
from parallel_robot.bags.counts import TopicCount, count
from parallel_robot.bags.message_arrays import Samples, ours, physical, whole
from parallel_robot.bags.span import WHOLE, Span
from parallel_robot.bags.state_doubts import doubts
from parallel_robot_control.contract import JointReference
from parallel_robot_control.extrapolation import extrapolate_rows
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.loop import SWAPPED, LoopParameters
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import RECORDED, Topic
from parallel_robot_sim.imperfections import told_age

FEW = 5  # topics of a bag that are named
EMPTY = np.zeros((0, 0))
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

    @property
    def has_velocities(self) -> bool:
        """Whether the rates of the joints were measured."""
        return not np.isnan(self.velocity).any()


def of(
    bag: Path,
    found: Bag[list[Samples]],
    streams: Mapping[Topic, list[Samples]],
    settings: tuple[dict[str, Any], LoopParameters, int],
    span: Span = WHOLE,
) -> RunLog:
    """The run of a bag, or a part of it.

    Args:
        bag: The bag, for error messages.
        found: What was read of it.
        streams: Its messages, see :func:`streams_of`.
        settings: See :func:`experiment.configuration`.
        span: The part; messages around it are there, too.

    Raises:
        BagError: it is not of a run, or a topic that the log needs is not in it.
    """
    streams = dict(streams)
    for needed in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS):
        if needed not in streams:
            raise BagError(f'{bag} has no messages on {_wanted(needed, streams, found.channels)}')
    values, loop, start = settings
    warnings = [*found.warnings]
    for topic in (topics.JOINT_STATES, topics.REFERENCE):
        streams[topic], remarks = ours(topic, streams[topic], loop.joints)
        warnings += [f'{bag}: {remark}' for remark in remarks]
    states, references, commands = (
        whole(bag, topic, streams[topic], loop.joints)
        for topic in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
    )
    states = _physical(bag, topics.JOINT_STATES, states, warnings)
    references = _physical(bag, topics.REFERENCE, references, warnings)
    states = _ordered(bag, topics.JOINT_STATES, states, warnings)
    references = _ordered(bag, topics.REFERENCE, references, warnings)
    if 'velocity' not in states.numbers:
        states.numbers['velocity'] = np.full_like(states.numbers['position'], np.nan)
        warnings.append(f'{bag}: the messages on {topics.JOINT_STATES.name} have no velocities')
    has_efforts = 'effort' in states.numbers
    if not has_efforts:
        what = f'the messages on {topics.JOINT_STATES.name} have no efforts'
        warnings.append(f'{bag}: {what}: torques are those commanded')
    recorded = command_states.recorded(streams.get(topics.ANSWERED, []), commands)
    commands.numbers['data'][~physical(commands)] = np.nan  # as if there were none
    start = start or int(max(states.stamps[0], references.stamps[0]))
    age = told_age(values)
    used = (states.stamps + age >= start) & (states.stamps + age >= references.stamps[0])
    if not used.any():
        raise BagError(f'{bag}: no state has a reference at or before its stamp')
    stamps = states.stamps[used]
    if len(stamps) > 1 and not (stamps[-1] > stamps[0] and np.median(np.diff(stamps)) > 0.0):
        raise BagError(f'{bag}: the stamps of {topics.JOINT_STATES.name} do not increase')
    repeated = len(stamps) - len(np.unique(stamps))
    if repeated:
        what = f'{repeated} messages on {topics.JOINT_STATES.name} repeat a stamp'
        warnings.append(f'{bag}: {what}: the motion was reset, or had two publishers')
    position = states.numbers['position'][used]
    warnings += [f'{bag}: {doubt}' for doubt in doubts(bag, stamps, position)]
    limit = _reference_timeout(values, references.stamps)
    referenced = newest_age(stamps + age, references.stamps) <= limit
    if not referenced.all():
        warnings.append(f'{bag}: {_unreferenced(stamps, start, references.stamps, referenced)}')
    if not found.metadata:
        robot = f'{values["robot_model"]} with the parameters of the paper'
        warnings.append(f'{bag} does not say of which robot it is: taken to be of {robot}')
    answer, answers, in_use = _answers(
        stamps, states, references, commands, recorded, span == WHOLE
    )
    run = RunLog(
        loop.scenario if found.metadata else 'unknown',
        loop.law if found.metadata else 'unknown',
        loop.joints,
        values,
        start,
        stamps,
        (stamps - start) / NANOSECONDS,
        position,
        states.numbers['velocity'][used],
        states.numbers['effort'][used] if has_efforts else _commanded(answer),
        *reference_at(
            stamps, references.stamps, *(references.numbers[name] for name in REFERENCE_FIELDS)
        ),
        commands.numbers['data'],
        count(streams, loop.period_ns, recorded, span),
        answer,
        states.log_times[used],
        answers,
        in_use,
        has_efforts,
        tuple(warnings),
        referenced,
    )
    if span == WHOLE:
        return run
    return rows(run, np.flatnonzero((run.stamps >= span.begin) & (run.stamps < span.end)))


def _wanted(topic: Topic, found: Mapping[Topic, Any], channels: Mapping[str, str]) -> str:
    """A topic that a bag lacks, its type, and which topics it has that may be meant.

    Args:
        topic: The topic.
        found: The topics that the bag has.
        channels: Type of each of its topics, by its full name.
    """
    kind, taken = topic.type.replace('/msg/', '/'), {other.name for other in found}
    others = [
        f'{printable(name, 60)} ({printable(other, 60)})'
        for name, other in channels.items()
        if (other.replace('/msg/', '/') == kind or name.endswith(f'/{topic.name}'))
        and name.lstrip('/') not in taken
    ]
    what = f'{topic.name} ({topic.type})'
    return f'{what}; it has {", ".join(others[:FEW])}' if others else what


def _commanded(answer: np.ndarray) -> np.ndarray:
    """Torques commanded before each state: the last answer to an earlier one, at first zero.

    Args:
        answer: Command that answered each state [N m], NaN where there is none, shape (N, n).
    """
    given = np.vstack([np.zeros((1, answer.shape[1])), answer[:-1]])
    known = np.isfinite(given).all(axis=1)
    return given[np.maximum.accumulate(np.where(known, np.arange(len(given)), 0))]


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
        what = f'{count} states, from t = {time:.3f} s on, have no reference of their time'
        return f'{what}: they have no error and are left out'
    behind = float(np.median(stamps) - np.median(known)) / NANOSECONDS
    return (
        'no state has a reference of its time: the stamps of '
        f'{topics.REFERENCE.name} are {behind:.3g} s behind those of {topics.JOINT_STATES.name}: '
        'of another clock'
    )


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
        raise BagError(f'{bag}: no message on {topic.name} has numbers that a robot can have')
    what = f'{count} messages on {topic.name} have numbers that no robot can have'
    warnings.append(f'{bag}: {what}; they are left out')
    return samples.rows(kept)


def streams_of(
    bag: Path, found: Mapping[str, Sequence[Sequence[Samples]]]
) -> dict[Topic, list[Samples]]:
    """Streams of the suite's topics, all in one namespace.

    Args:
        bag: The bag, for error messages.
        found: Messages by full name of the topic.

    Raises:
        BagError: those of several robots are there.
    """
    end = f'/{topics.JOINT_STATES.name}'
    spaces = [name.removesuffix(end) for name in found if name.endswith(end)]
    if len(spaces) > 1 and '' not in spaces:
        raise BagError(f'{bag} holds several runs, in {", ".join(sorted(spaces))}')
    space = '' if '' in spaces or not spaces else spaces[0]
    streams = {topic: found.get(f'{space}/{topic.name}', []) for topic in RECORDED}
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
