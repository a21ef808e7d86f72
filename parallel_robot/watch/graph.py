"""What the screen needs of a running graph; :class:`ros_graph.RosGraph` is one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Tell = Callable[[bool, str], None]  # whether it was done, and the answer of the node


class Graph(Protocol):
    """Listens to all robots; sends requests to the controller of the one that is watched."""

    def watch(self, namespace: str) -> None:
        """Subscribe to what one robot tells, by its namespace, instead of another."""

    def look(self) -> None:
        """Take all messages since the last look."""

    def answers(self) -> None:
        """Pass on the answers of the controller."""

    def switch_law(self, law: str, tell: Tell) -> None:
        """Ask for another law."""

    def emergency_stop(self, tell: Tell) -> None:
        """Ask for the safe action."""

    def clear_fault(self, tell: Tell) -> None:
        """Ask for the end of the safe action."""
