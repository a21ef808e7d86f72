"""Bags in which joints alone were recorded, without references or commands.

Who looks at the motion alone needs neither. Samples that stand in for what is not there let the
bag be read as every other, and are taken out again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.messages.topics import COMMANDS, JOINT_STATES, REFERENCE, Topic


def filled(
    streams: Mapping[Topic, list[Samples]], joints: Callable[[], tuple[str, ...]]
) -> tuple[dict[Topic, list[Samples]], tuple[Topic, ...]]:
    """Streams of a bag with samples in place of references and commands that are not there.

    Args:
        streams: Those of the bag.
        joints: Tells the names of the joints, where they are needed.

    Returns:
        The streams, and the topics that are not there.
    """
    absent = tuple(topic for topic in (REFERENCE, COMMANDS) if topic not in streams)
    found, states = dict(streams), streams.get(JOINT_STATES, [])
    if absent and states:
        size = len(joints())
        found |= {topic: [_instead(topic, part, size) for part in states] for topic in absent}
    return found, absent


def cleared(log: RunLog, absent: Collection[Topic]) -> RunLog:
    """A run without what stood in for topics that are not there."""
    messages = dict(log.messages)
    for topic in absent:
        messages.pop(topic.name, None)
    log = log._replace(messages=messages)
    if REFERENCE in absent:
        none = np.full_like(log.position, np.nan)
        log = log._replace(
            reference_position=none,
            reference_velocity=none,
            reference_acceleration=none,
            referenced=np.zeros(len(log.stamps), bool),
        )
    return log._replace(command=log.command[:0]) if COMMANDS in absent else log


def _instead(topic: Topic, states: Samples, size: int) -> Samples:
    """Samples as if each state had one of a topic, for so many joints."""
    position = states.numbers['position']
    if topic == REFERENCE:
        zero = np.zeros_like(position)
        numbers = {'position': position, 'velocity': zero, 'acceleration': zero}
        return Samples(states.joints, states.log_times, states.stamps, numbers)
    data = {'data': np.full((len(position), size), np.nan)}
    return Samples((), states.log_times, np.zeros_like(states.stamps), data)
