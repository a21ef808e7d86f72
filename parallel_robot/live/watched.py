"""Which robot of a graph is watched, and what its nodes say of themselves."""

from __future__ import annotations

from typing import Any, Protocol

from parallel_robot.watch.graph import Tell
from parallel_robot.watch.robots import Robots
from parallel_robot_model.messages import topics


class Graph(Protocol):
    """What is needed of ros_live_graph.LiveGraph."""

    parameters: dict[str, dict[str, Any]]
    descriptions: dict[str, dict[str, Any]]

    def watch(self, namespace: str) -> None:
        """Read one robot, by its namespace."""

    def look(self) -> None:
        """Take all that has come."""

    def heard(self, topic: topics.Topic, joints: tuple[str, ...]) -> Any:
        """Messages of states or references since the last call."""

    def ask_parameters(self) -> None:
        """Ask the nodes for their parameters, where they are not known."""

    def forget(self) -> None:
        """Ask for all parameters anew."""

    def set_parameter(self, node: str, key: str, value: Any, tell: Tell) -> None:
        """Change a parameter of a node."""

    def emergency_stop(self, tell: Tell) -> None:
        """Begin the safe action."""

    def clear_fault(self, tell: Tell) -> None:
        """End the safe action."""

    def reset(self, tell: Tell) -> None:
        """Put the robot back to its start."""


class Watched:
    """The robot of a namespace, or the first that is heard.

    Attributes:
        namespace: Full name of its namespace.
        parameters: Parameters by node, as they were when they were last looked at.
        started: Whether its trajectory node was not known before that.
    """

    def __init__(self, graph: Graph, robots: Robots, namespace: str | None) -> None:
        """Watch.

        Args:
            graph: The graph; the caller enters and leaves it.
            robots: What its nodes report.
            namespace: Full name; None for the first that is heard.
        """
        self._graph, self._robots = graph, robots
        self._fixed, self.namespace = namespace is not None, namespace or ''
        self.parameters: dict[str, dict[str, Any]] = {}
        self.started = False
        graph.watch(self.namespace)

    def changed(self) -> bool:
        """See which nodes run; whether their parameters are others than before."""
        names = self._robots.names()
        if not self._fixed and names and self.namespace not in names:
            self.namespace = names[0]
            self._graph.watch(names[0])
        if names:
            self._graph.ask_parameters()
        before, self.parameters = self.parameters, dict(self._graph.parameters)
        self.started = 'trajectory' in self.parameters.keys() - before.keys()
        return self.parameters != before
