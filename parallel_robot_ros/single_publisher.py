"""Detects by the numbers of its messages that a topic has two publishers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

SETTLED = (
    1.0  # s without a change of publisher, after which a topic is taken to have one publisher
)


class SinglePublisher:
    """Watches the numbers of the messages of a topic, at any rate.

    The middleware numbers the messages of each publisher one by one. Numbers that go back once
    come from a publisher that was restarted; numbers that go back again and again, from two that
    publish in turn. Gaps are losses. Without numbers of the middleware, nothing is noticed.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Take the first message as it comes; `clock` gives the time [s]."""
        self._clock = clock
        self._number = 0
        self._back_at = -math.inf
        self._settled = True
        self._several = False

    def mixed(self, number: int) -> bool:
        """Whether a message is one of several publishers, so that it must not be used.

        Args:
            number: Its number, which its publisher counts from 1 on; 0: not known.
        """
        last, self._number = self._number, number
        if self._settled and number > last:  # nearly always
            return False
        now = self._clock()
        self._settled = now - self._back_at >= SETTLED
        if number and number <= last:
            self._several = not self._settled
            self._settled, self._back_at = False, now
        elif self._settled:
            self._several = False
        return self._several
