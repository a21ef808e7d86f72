"""A part of a run: between which stamps, and between which log times where there are none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot_model.messages.topics import ANSWERED, UNSTAMPED, Topic

FIRST, LAST = -(1 << 62), 1 << 62  # before and after all stamps and log times [ns]


class Span(NamedTuple):
    """A part of a run.

    Attributes:
        begin: First stamp [ns].
        end: The stamp after the last [ns].
        begin_heard: First log time of messages without a stamp [ns].
        end_heard: The log time after their last [ns].
    """

    begin: int = FIRST
    end: int = LAST
    begin_heard: int = FIRST
    end_heard: int = LAST

    def holds(self, topic: Topic, messages: Samples) -> np.ndarray:
        """Which messages of a topic are of this part, shape (N,)."""
        if topic.every and topic.type not in (*UNSTAMPED, ANSWERED.type):
            return (messages.stamps >= self.begin) & (messages.stamps < self.end)
        return (messages.log_times >= self.begin_heard) & (messages.log_times < self.end_heard)


WHOLE = Span()
