"""Telemetry of the controller in a bag: fewer rows than states, or none."""

from __future__ import annotations

from pathlib import Path

from parallel_robot.bags import bag_reader, run_log
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.message_arrays import Samples, decoder, whole
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages.topics import Topic


def read(bag: Path, log: run_log.RunLog, topic: Topic, memory: int = MEMORY) -> Samples | None:
    """Read a topic with a position for each joint.

    Args:
        bag: The bag that `log` was read from.
        log: The run.
        topic: One of TELEMETRY.
        memory: What may be held of the bag [bytes].

    Returns:
        Its messages; None when the bag has none for these joints.
    """
    try:
        found = bag_reader.read(bag, (topic,), decoder(bag, (topic,)), memory)
        return whole(bag, topic, run_log.streams_of(bag, found.streams, topic)[topic], log.joints)
    except (BagError, KeyError):  # a topic of that name that is not the suite's
        return None
