"""What a bag holds, read at one go: its run, what happened beside it, and telemetry."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from parallel_robot.bags import (
    bag_reader,
    history,
    message_arrays,
    motion_alone,
    run_log,
    statuses,
)
from parallel_robot.bags.bag_reader import Messages
from parallel_robot.bags.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.experiment import configuration
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.message_arrays import LOG, Samples
from parallel_robot.bags.run_log import RunLog
from parallel_robot.bags.statuses import ControllerStatus
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages.topics import RECORDED, STATUS, Topic


class Recording(NamedTuple):
    """What a bag holds.

    Attributes:
        log: The run.
        history: What happened beside the motion.
        extra: Messages of the other topics that were asked for; without those that the bag does
            not have for these joints.
    """

    log: RunLog
    history: History
    extra: dict[Topic, Samples]


def read(
    bag: str | Path,
    topics: Collection[Topic] = (),
    memory: int = MEMORY,
    motion_only: bool = False,
    view: BagView = AS_RECORDED,
) -> Recording:
    """Read a bag of the nodes, of a simulation, or of any recorder that heard the suite's topics.

    Damaged parts are left out; the warnings of the log say so.

    Args:
        bag: Directory of the bag, or its MCAP file.
        topics: What else is wanted, of TELEMETRY: topics with a position for each joint.
        memory: What may be held of it [bytes].
        motion_only: Whether references and commands may be missing: NaN, and none.
        view: What it does not say itself, and which part is wanted.

    Raises:
        BagError: not a bag, or one that is not of a run or takes too much; or a topic that the
            log needs is not in it.
    """
    bag = Path(bag)
    decode, others = message_arrays.decoder(bag, {*LOG, *topics}), message_arrays.decoder(bag, ())
    status = statuses.decoder(bag)
    told: list[tuple[int, ControllerStatus]] = []

    def condense(topic: Topic, messages: Messages) -> list[Samples]:
        if topic == STATUS:
            told.extend(status(topic, messages))
        try:
            return decode(topic, messages)
        except BagError:
            if topic not in topics:
                raise
            return others(topic, messages)  # of that name, but not the suite's

    found = bag_reader.read(bag, RECORDED, condense, memory, view)
    streams, past = run_log.streams_of(bag, found.streams, view), history.of(found, told)
    absent: tuple[Topic, ...] = ()
    present = streams
    if motion_only:
        streams, absent = motion_alone.filled(
            streams, lambda: configuration(bag, found.metadata, past.parameters, view)[1].joints
        )
    log = run_log.of(bag, found, streams, past.parameters, view)
    log = motion_alone.cleared(log, absent)
    lacking = [
        f'{bag} has no messages on {run_log.wanted(topic, present, found)}' for topic in absent
    ]
    log = log._replace(warnings=(*log.warnings, *lacking))
    if not view.whole:
        log = run_log.between(bag, log, view.start, view.stop)
    extra = {}
    for topic in {*topics} & streams.keys():
        try:
            extra[topic] = message_arrays.whole(bag, topic, streams[topic], log.joints)
        except BagError:  # of other joints, or not the suite's
            continue
    return Recording(log, past, extra)
