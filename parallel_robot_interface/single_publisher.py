"""Keeps the messages of two publishers on one topic apart, by the numbers that they give them."""

from __future__ import annotations

SETTLED = 1.0  # s without a change of publisher, after which a topic is believed to have one


class SinglePublisher:
    """Watches the numbers of the messages of a topic, of whatever rate.

    The middleware numbers the messages of each publisher one by one. Numbers that go back once
    are of a publisher that was started again; again and again, of two that publish in turn. Gaps
    are losses. Where a middleware has no numbers, nothing is noticed.
    """

    def __init__(self) -> None:
        """Believe what comes first."""
        self._number = 0
        self._back_at = -SETTLED
        self._several = False

    def mixed(self, number: int, now: float) -> bool:
        """Whether a message is one of several publishers, so that it must not be used.

        Args:
            number: That which its publisher gave it, from 1 on; 0: not known.
            now: Time of its reception [s].
        """
        settled = now - self._back_at >= SETTLED
        if number and number <= self._number:
            self._several = not settled
            self._back_at = now
        elif settled:
            self._several = False
        self._number = number
        return self._several
