"""States, references and commands of a run, without those that cannot be of its robot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.messages import planned_motion
from parallel_robot.bags.messages.message_arrays import Samples, ours, physical, strange, whole
from parallel_robot.bags.reading.bag_reader import Bag
from parallel_robot.bags.run import matching
from parallel_robot.bags.run.matching import Answers
from parallel_robot.bags.run.run_topics import NEEDED, wanted
from parallel_robot.bags.run.state_doubts import LEAP, leaping
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import JointUnits
from parallel_robot_model.configuration.loop import SWAPPED
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic

FEW_LEAPS = 0.2  # of the states, which may be of another publisher


class RunMessages(NamedTuple):
    """Messages of a run, each kind in one piece.

    Attributes:
        states: In the order of their stamps, with velocities, NaN where the bag has none.
        references: In the order of their stamps.
        commands: In their own order, NaN where no robot can obey.
        recorded: The commands with the states that they answer; None where the bag does not say.
        streams: All messages of its topics, those of other publishers left out.
        warnings: What was left out or put in order, one line each.
    """

    states: Samples
    references: Samples
    commands: Samples
    recorded: Answers | None
    streams: Mapping[Topic, list[Samples]]
    warnings: list[str]


def of(
    bag: Path,
    found: Bag[list[Samples]],
    streams: Mapping[Topic, list[Samples]],
    joints: tuple[str, ...],
    units: JointUnits,
) -> RunMessages:
    """The messages of a run, or of a part of it.

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
            raise BagError(f'{bag} has no messages on {wanted(needed, streams, found)}')
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
    states, references, commands = (whole(bag, each, streams[each], joints) for each in NEEDED)
    states = _physical(bag, topics.JOINT_STATES, states, warnings)
    references = _physical(bag, topics.REFERENCE, references, warnings)
    states = _ordered(bag, topics.JOINT_STATES, states, warnings)
    references = _ordered(bag, topics.REFERENCE, references, warnings)
    if not found.metadata:
        states = _alone(bag, states, warnings, units)
    if 'velocity' not in states.numbers:
        states.numbers['velocity'] = np.full_like(states.numbers['position'], np.nan)
        warnings.append(f'{bag}: the messages on {topics.JOINT_STATES.name} have no velocities')
    if 'effort' not in states.numbers:
        what = f'the messages on {topics.JOINT_STATES.name} have no efforts'
        warnings.append(f'{bag}: {what}: torques are those commanded')
    recorded = matching.recorded_answers(streams.get(topics.ANSWERED, []), commands)
    commands.numbers['data'][~physical(commands)] = np.nan  # as if there were none
    return RunMessages(states, references, commands, recorded, streams, warnings)


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
