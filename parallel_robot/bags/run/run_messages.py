"""States, references and commands of a run, without those that cannot be of its robot."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.bag_reader import AS_RECORDED, INSTEAD, Bag, BagView
from parallel_robot.bags.files.bag_files import files
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.messages import planned_motion
from parallel_robot.bags.messages.message_arrays import Samples, ours, physical, strange, whole
from parallel_robot.bags.run import matching
from parallel_robot.bags.run.joint_table import is_table
from parallel_robot.bags.run.matching import Answers
from parallel_robot_model.common.errors import BagError, printable
from parallel_robot_model.common.units import HINGES, NANOSECONDS, JointUnits, beyond_a_turn
from parallel_robot_model.configuration.loop import SWAPPED
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import RECORDED, Topic

# Which topics of a bag are those of a run, and what is said of one that is not there.

FEW = 5  # topics of a bag that are named
NEEDED = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)


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


def wanted(bag: Path, topic: Topic, known: Mapping[Topic, Any], found: Bag[Any]) -> str:
    """That a bag lacks a topic, what may be meant instead, and the option that says so.

    Args:
        bag: The bag.
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
    what = f'{bag} has no messages on {topic.name} ({topic.type})'
    if not others:
        names = ', '.join(printable(name, 60) for name in [*channels][:FEW])
        names += f' and {len(channels) - FEW} others' if len(channels) > FEW else ''
        needless = '; analyze, export and identify need none, and simulate follows the joints '
        needless += 'that export writes, as waypoints.file with waypoints.space=joints'
        needless = needless if topic == topics.REFERENCE else ''
        return (
            f'{what}, nor on another topic of that type; it has {names or "no topics"}{needless}'
        )
    counts = _counts(bag)
    empty = {name for name, _ in others if not counts.get(name, 1)}
    shown = ', '.join(
        f'{printable(name, 60)} ({printable(other, 60)}'
        + (f' as {found.encodings[name]:.20}' if name in found.encodings else '')
        + (')' if name not in empty else '), without a message')
        for name, other in others[:FEW]
    )
    alike = [name for name, other in others if other in (topic.type, *INSTEAD.get(topic, ()))]
    strange = any(name in found.encodings for name, _ in others)
    alike = [name for name in alike if name not in {*found.encodings, *empty}]
    if not alike:
        help_text = '; only messages as cdr, of ROS 2, are read' if strange else ''
        return f'{what}; it has {shown}{help_text}'
    word = topic.name.rpartition('/')[2]
    return f'{what}; it has {shown}: --topic {word}={printable(alike[0], 60)} takes it'


def _counts(bag: Path) -> dict[str, int]:
    """Messages of each topic by full name, as far as they are known."""
    try:
        return dict(BagReader(bag, make_index=True).counts)
    except BagError:
        return {}


# Doubts about recorded states: several recordings taken for one, other units or signs.

GAP = 1.0  # s without states, in which a robot is not recorded
LEAP = 0.1  # rad, to and back within two samples: not the motion of one robot
BACK = 0.1  # of a leap, by which its ends may differ
ROUNDING = 1e-6  # of a limit, by which efforts may be beyond it


def doubts(
    bag: Path, stamps: np.ndarray, position: np.ndarray, units: JointUnits = HINGES
) -> list[str]:
    """What makes recorded states look like those of more than one run, one line each.

    Args:
        bag: The bag.
        stamps: Of the states [ns], shape (N,).
        position: Actuated joints [rad], shape (N, n).
        units: Those of the joints.
    """
    found = []
    steps = np.diff(stamps) / NANOSECONDS
    if len(steps) and steps.max() > GAP:
        names = [path.name for path in files(bag)]
        count = int((steps > GAP).sum())
        where = 'one place' if count == 1 else f'{count} places'
        what = f'no states for {steps.max():.4g} s' + (f', in {where}' if count > 1 else '')
        if len(names) > 1:
            what += f': several recordings, in {", ".join(names)}? figures are of all together; '
            what += 'give one file for its own, or a part of them by --from and --to'
        found.append(what)
    leaps = int(leaping(position).sum())
    if leaps:
        what = f'{leaps} states leap by more than {LEAP:g} {units.of("rad")} and back'
        found.append(f'{what}: two publishers that contradict each other?')
    back = np.diff(stamps) < 0
    if back.any():
        what = f'the stamps of states go back by up to {-steps.min():.3g} s'
        found.append(f'{what}: a clock was set, or there are several runs')
    return found


def beyond(position: np.ndarray, units: JointUnits = HINGES) -> list[str]:
    """That joints go beyond a whole turn, a line, if they do.

    Args:
        position: Actuated joints [rad], shape (N, n).
        units: Those of the joints.
    """
    far = beyond_a_turn(position, units)
    return [f'a joint reaches {far}'] if far else []


def too_strong(effort: np.ndarray, limit: np.ndarray, units: JointUnits = HINGES) -> list[str]:
    """That efforts are beyond what the motors can give, a line, if they are.

    Args:
        effort: Of the joints [N m], shape (N, n).
        limit: Of the motors [N m], shape (n,) or ().
        units: Those of the joints.
    """
    if limit.size not in (1, effort.shape[1]):
        return []
    excess = (np.abs(effort) - (1.0 + ROUNDING) * limit).max(axis=0, initial=-np.inf)
    k = int(np.argmax(excess))
    if not excess[k] > 0.0:
        return []
    unit, most = units.one(k).of('N m'), float(np.abs(effort[:, k]).max())
    own = float(np.broadcast_to(limit, effort.shape[1])[k])
    what = f'efforts reach {most:.4g} {unit}, more than plant.torque_limit, {own:g} {unit}'
    return [f'{what}: are they in {unit}?']


def leaping(position: np.ndarray) -> np.ndarray:
    """Which states lie far beside both their neighbours, which agree, shape (N,).

    None where the motion is so fast, or so coarse, that its steps are near to leaps. The first and
    the last state have one neighbour; they are told by it where there are others.
    """
    found = np.zeros(len(position), bool)
    steps = np.abs(np.diff(position, axis=0))
    if len(steps) < 2 or np.median(steps) > BACK * LEAP:
        return found
    least = np.minimum(steps[:-1], steps[1:])
    leap = (least > LEAP) & (np.abs(position[2:] - position[:-2]) < BACK * least)
    found[1:-1] = leap.any(axis=1)
    if found.any():
        for end, near, inner in ((0, 0, 1), (-1, -1, -2)):
            alone = (steps[near] > LEAP) & (steps[inner] < BACK * LEAP)
            found[end] = alone.any()
    return found


FEW_LEAPS = 0.2  # of the states, which may be of another publisher


class Messages(NamedTuple):
    """The messages of a run, or of a part of it."""

    states: Samples  # in the order of their stamps, with velocities, NaN where there are none
    references: Samples  # in the order of their stamps
    commands: Samples  # NaN where no robot can obey
    answers: Answers | None  # commands with the states that they answer; None: nobody says
    streams: dict[Topic, list[Samples]]  # all of its topics, without those of other publishers
    warnings: list[str]  # what was left out or put in order, one line each


def of(
    bag: Path,
    found: Bag[list[Samples]],
    streams: Mapping[Topic, list[Samples]],
    joints: tuple[str, ...],
    units: JointUnits,
) -> Messages:
    """The messages of a run, or of a part of it, cleaned.

    Args:
        bag: The bag, for error messages.
        found: What was read of it.
        streams: Its messages by topic.
        joints: Names of the actuated joints.
        units: Units of the joints.

    Raises:
        BagError: a topic that is needed is not there, or not understood.
    """
    for needed in NEEDED:
        if needed not in streams:
            raise BagError(wanted(bag, needed, streams, found))
    streams, warnings = dict(streams), [*found.warnings]
    for topic in (topics.JOINT_STATES, topics.REFERENCE):
        streams[topic], remarks = ours(topic, streams[topic], joints)
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
        _once(bag, each, whole(bag, each, streams[each], joints), warnings) for each in NEEDED
    )
    streams |= {
        each: [one] for each, one in zip(NEEDED, (states, references, commands), strict=True)
    }
    for clean in (_physical, _ordered):
        states = clean(bag, topics.JOINT_STATES, states, warnings)
        references = clean(bag, topics.REFERENCE, references, warnings)
    if not found.metadata:
        states = _alone(bag, states, warnings, units)
    if 'velocity' not in states.numbers:
        states.numbers['velocity'] = np.full_like(states.numbers['position'], np.nan)
        if not is_table(bag):
            what = f'the messages on {topics.JOINT_STATES.name} have no velocities'
            warnings.append(f'{bag}: {what}')
    if 'effort' not in states.numbers and not is_table(bag):
        what = f'the messages on {topics.JOINT_STATES.name} have no efforts'
        warnings.append(f'{bag}: {what}: torques are those commanded')
    recorded = matching.recorded_answers(streams.get(topics.ANSWERED, []), commands)
    commands.numbers['data'][~physical(commands)] = np.nan  # as if there were none
    return Messages(states, references, commands, recorded, streams, warnings)


APART = 1_000_000_000  # ns, between what two recorders wrote of one message; more is another run


def _once(bag: Path, topic: Topic, samples: Samples, warnings: list[str]) -> Samples:
    """Count equal messages of one time once, as of two recorders, with a line in `warnings`."""
    times = samples.log_times if topic == topics.COMMANDS else samples.stamps  # without a stamp
    order = np.argsort(times, kind='stable')
    again = (np.diff(times[order]) == 0) & (np.diff(samples.log_times[order]) < APART)
    if not again.any():
        return samples
    for numbers in samples.numbers.values():
        bits = np.ascontiguousarray(numbers[order]).view(np.int64)
        again &= (bits[1:] == bits[:-1]).all(axis=1)
    if not again.any():
        return samples
    kept = np.ones(len(times), bool)
    kept[order[1:][again]] = False
    what = f'{int(again.sum())} messages on {topic.name} were recorded twice'
    warnings.append(f'{bag}: {what}: equal stamps, equal numbers; they count once')
    return samples.rows(kept)


def _physical(bag: Path, topic: Topic, samples: Samples, warnings: list[str]) -> Samples:
    """Leave out samples whose numbers no robot can have, with a line in `warnings`."""
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
