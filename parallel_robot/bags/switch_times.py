"""When a law became active in lockstep: its name has no stamp, but the status with it has."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

from parallel_robot.bags.message_types import deserialize
from parallel_robot_model.messages.cdr_reader import header_stamp
from parallel_robot_model.messages.topics import ACTIVE_LAW, STATUS

MOST = 100  # names, and statuses, that may wait for each other


class SwitchTimes:
    """Dates the messages that name the active law by the statuses that name it too.

    The controller publishes both at a switch, on two topics: either may come first. Before the
    first state it names its law alone.
    """

    def __init__(self, start: int) -> None:
        """Begin at a stamp [ns], which names without a status get."""
        self._time = start
        self._law = ''  # of the newest status
        self._switches: deque[tuple[str, int]] = deque(
            maxlen=MOST
        )  # law and stamp, without a name so far
        self._names: deque[tuple[str, bytes]] = deque()  # law and message

    def add_status(self, message: bytes) -> None:
        """Take a message on ``controller/status``."""
        law, stamp = _law_of_status(message), header_stamp(message)
        if law not in ('', self._law) and stamp is not None:
            self._law = law
            self._switches.append((law, stamp))

    def add_name(self, message: bytes) -> None:
        """Take a message on ``controller/active_law``."""
        self._names.append((_law_of_name(message), message))

    def dated(self) -> Iterator[tuple[int, bytes]]:
        """Messages whose time is known by now [ns], in their order, each once."""
        while pair := self._pair():
            name, switch = pair
            for _ in range(name):  # without a status: sent before any state
                yield self._time, self._names.popleft()[1]
            for _ in range(switch + 1):
                self._time = self._switches.popleft()[1]
            yield self._time, self._names.popleft()[1]
        while len(self._names) > MOST:
            yield self._time, self._names.popleft()[1]

    def rest(self) -> Iterator[tuple[int, bytes]]:
        """Messages whose status never came, with the time of the last switch [ns]."""
        while self._names:
            yield self._time, self._names.popleft()[1]

    def _pair(self) -> tuple[int, int] | None:
        """Places of the first name with a status, and of that status."""
        laws = [law for law, _ in self._switches]
        for place, (law, _) in enumerate(self._names):
            if law in laws:
                return place, laws.index(law)
        return None


def _law_of_status(message: bytes) -> str:
    """Name of the law in a status; empty if it is broken or not the suite's."""
    try:
        status: Any = deserialize(message, STATUS.type)
        return str(next(item.value for item in status.status[0].values if item.key == 'law'))
    except Exception:  # in broken bytes, any length or string can be wrong
        return ''


def _law_of_name(message: bytes) -> str:
    try:
        name: Any = deserialize(message, ACTIVE_LAW.type)
        return str(name.data)
    except Exception:  # in broken bytes, any length or string can be wrong
        return ''
