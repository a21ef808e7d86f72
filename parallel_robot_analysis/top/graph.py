"""What the screen needs of a running graph; :class:`ros_graph.RosGraph` is one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Tell = Callable[[bool, str], None]  # whether it was done, and what the node says


class Graph(Protocol):
    """Hears all robots, and asks the controller of the one that is watched."""

    def watch(self, namespace: str) -> None:
        """Hear status and poses of one robot, by its namespace, and no longer those of another."""

    def look(self) -> None:
        """Take all that has come since the last look."""

    def answers(self) -> None:
        """Tell those who asked what the controller has answered."""

    def switch_law(self, law: str, tell: Tell) -> None:
        """Ask for another law."""

    def emergency_stop(self, tell: Tell) -> None:
        """Ask for the safe action."""

    def clear_fault(self, tell: Tell) -> None:
        """Ask for the end of the safe action."""
