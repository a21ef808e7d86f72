"""What the server needs of what it shows: a running graph or a bag."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from parallel_robot_model.common.errors import ParallelRobotError


class RefusedError(ParallelRobotError):
    """What a browser asked for was refused; the text says why."""


class Description(NamedTuple):
    """What a node says of a parameter.

    Attributes:
        text: Its meaning, with the unit in brackets.
        low: Smallest value, if there is one.
        high: Largest value, likewise.
        fixed: Whether it cannot be changed.
    """

    text: str
    low: float | None
    high: float | None
    fixed: bool = False


class Source(Protocol):
    """Something that moves and can be acted on."""

    def look(self) -> list[bytes]:
        """Frames since the last call, the newest last; see frames.py."""

    def texts(self) -> dict[str, Any]:
        """What else a browser knows, as plain data by name; sent when it has changed."""

    async def act(self, action: str, value: Any) -> str:
        """Do what a browser asks for.

        Args:
            action: Its name.
            value: What the action needs, plain data from outside: nothing of it is checked yet.

        Returns:
            What was done, for the user.

        Raises:
            RefusedError: it is not done.
            KeyError: there is no such action.
        """
