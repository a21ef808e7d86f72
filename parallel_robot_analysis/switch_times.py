"""When a law became active, in lockstep: its name has no stamp, but the status with it has one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator


class SwitchTimes:
    """Gives messages with the name of the active law the stamps of the statuses that say so too.

    The controller publishes both at a switch, on two topics: either may come first. Before the
    first state it names its law alone.
    """

    def __init__(self, start: int) -> None:
        """Begin at a stamp [ns], that of names without a status."""
        self._time = start
        self._law = ''  # of the newest status
        self._switches: deque[tuple[str, int]] = deque()  # law and stamp, that no name has yet
        self._names: deque[tuple[str, bytes]] = deque()  # law and message, that have no time yet

    def add_status(self, law: str, stamp: int) -> None:
        """Take a status: its law and its stamp [ns]."""
        if law != self._law:
            self._law = law
            self._switches.append((law, stamp))

    def add_name(self, law: str, message: bytes) -> None:
        """Take the name of the active law, and the message that it came in."""
        self._names.append((law, message))

    def dated(self) -> Iterator[tuple[int, bytes]]:
        """Messages whose time is known by now [ns], in their order, each once."""
        while pair := self._pair():
            name, switch = pair
            for _ in range(name):  # of them no status knows: they were sent before any state
                yield self._time, self._names.popleft()[1]
            for _ in range(switch + 1):
                self._time = self._switches.popleft()[1]
            yield self._time, self._names.popleft()[1]

    def rest(self) -> Iterator[tuple[int, bytes]]:
        """Messages whose status never came, with the time of the last switch [ns]."""
        while self._names:
            yield self._time, self._names.popleft()[1]

    def _pair(self) -> tuple[int, int] | None:
        """Places of the first name that a status has, and of that status."""
        laws = [law for law, _ in self._switches]
        for place, (law, _) in enumerate(self._names):
            if law in laws:
                return place, laws.index(law)
        return None
