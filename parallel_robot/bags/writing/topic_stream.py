"""The messages of one recorded topic: how many came, which are missing, how they are stamped."""

from __future__ import annotations

from functools import partial

from parallel_robot.bags.messages.message_types import Channel
from parallel_robot_model.messages.layouts import header_stamp, last_state
from parallel_robot_model.messages.topics import (
    ACTIVE_LAW,
    ANSWERED,
    CROSS_COUPLING_ERROR,
    ERROR,
    JOINT_STATES,
    RECORDED,
    SLIDING_VARIABLE,
    STATUS,
    SYNCHRONISATION_ERROR,
    UNSTAMPED,
    Topic,
)

MEASURED = (  # stamped when the state was measured, which may be before it was sent
    JOINT_STATES,
    ERROR,
    SYNCHRONISATION_ERROR,
    CROSS_COUPLING_ERROR,
    SLIDING_VARIABLE,
)


class TopicStream:
    """The messages of one topic: counted, and how their log times are found.

    Attributes:
        topic: One of the suite's, or any other.
        channel: How the topic is written.
        of_suite: Whether it is one of the suite's.
        stamp_of: Reads the stamp of a message [ns]; None for types without one.
        received: Messages taken.
    """

    def __init__(self, topic: Topic, channel: Channel, joints: int = 0) -> None:
        """Begin without messages; `joints`: how many the robot has, for topics of the suite."""
        self.topic, self.channel = topic, channel
        self.of_suite = topic in RECORDED
        self.is_log, self.is_state = topic == ANSWERED, topic == JOINT_STATES
        self.is_measured = topic in MEASURED
        self.is_law, self.is_status = topic == ACTIVE_LAW, topic == STATUS
        stamped = self.of_suite and topic.type not in UNSTAMPED
        read_stamp = partial(last_state, joints=joints) if self.is_log else header_stamp
        self.stamp_of = read_stamp if stamped else None
        self.received = 0
        self._missing: int | None = None
        self._restarted = False
        self._number = 0  # of the last message; 0: none had one

    def count(self, number: int) -> None:
        """Count a message, and numbers missing since the last one; a smaller number restarts."""
        self.received += 1
        if not number:
            return
        if not self._number:
            self._missing = 0
        elif number > self._number + 1 and self._missing is not None:
            self._missing += number - self._number - 1
        self._restarted |= number < self._number
        self._number = number

    @property
    def gaps(self) -> int | None:
        """Numbers missing between those that the publisher gave its messages.

        None where they are not known, several publishers number theirs, or none is missing but
        perhaps the last ones of a publisher that was started anew.
        """
        return None if self._restarted and not self._missing else self._missing

    def several(self) -> None:
        """Note that the topic has several publishers, whose numbers cannot be told apart."""
        self._missing = None
        self._number = self._number or 1
