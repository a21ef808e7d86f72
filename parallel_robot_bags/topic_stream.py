"""The messages of one recorded topic: how many came, which are missing, how they are stamped."""

from __future__ import annotations

from parallel_robot_bags.channels import Channel
from parallel_robot_base.cdr_reader import header_stamp, last_state
from parallel_robot_base.topics import (
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
        gaps: Numbers missing between those that the publisher gave its messages; None where they
            are not known or several publishers number theirs.
    """

    def __init__(self, topic: Topic, channel: Channel) -> None:
        self.topic, self.channel = topic, channel
        self.of_suite = topic in RECORDED
        self.is_log, self.is_state = topic == ANSWERED, topic == JOINT_STATES
        self.is_measured = topic in MEASURED
        self.is_law, self.is_status = topic == ACTIVE_LAW, topic == STATUS
        stamped = self.of_suite and topic.type not in UNSTAMPED
        self.stamp_of = (last_state if self.is_log else header_stamp) if stamped else None
        self.received = 0
        self.gaps: int | None = None
        self._number = 0  # of the last message; 0: none had one

    def count(self, number: int) -> None:
        """Count a message, and numbers missing since the last one; a smaller number restarts."""
        self.received += 1
        if not number:
            return
        if not self._number:
            self.gaps = 0
        elif number > self._number + 1 and self.gaps is not None:
            self.gaps += number - self._number - 1
        self._number = number

    def several(self) -> None:
        """Note that the topic has several publishers, whose numbers cannot be told apart."""
        self.gaps = None
        self._number = self._number or 1
