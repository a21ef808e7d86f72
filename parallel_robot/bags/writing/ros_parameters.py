"""Parameters of other nodes: their first values and every later change."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from parallel_robot_model.configuration.yaml_file import MOTION
from parallel_robot_model.messages.topics import DEPTH

Tell = Callable[[str, dict[str, Any]], None]  # full name of a node, its parameters
OTHERS = ('use_sim_time', 'start_stamp')  # these change at the start of a run
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # what rclpy calls a node of which only a topic is known so far
ANSWER_TIMEOUT = 5.0  # s, how long to wait for the answer of a node


class ParameterWatch:
    """Asks each node for its parameters once, and listens for changes."""

    def __init__(self, node: Node, found: Tell, changed: Tell) -> None:
        """Listen.

        Args:
            node: The node that asks.
            found: Called with all parameters of a node that was asked.
            changed: Called with the new values of parameters that were changed.
        """
        self._node = node
        self._found = found
        self._changed = changed
        itself = node.get_fully_qualified_name()
        self._seen: dict[str, float] = {itself: 0.0}  # s, when first seen
        self._present: set[str] = set()
        self._asked, self._answered = {itself}, {itself}
        self._clients: dict[str, tuple[Any, Any]] = {}
        node.create_subscription(ParameterEvent, '/parameter_events', self._on_event, DEPTH)

    def ask(self, names: Iterable[str]) -> None:
        """Ask the nodes among `names`, full names of all that are present, that were not asked."""
        self._present = set(names)
        for name in self._present:
            self._seen.setdefault(name, time.monotonic())
            if name in self._asked or UNKNOWN in name:
                continue
            if name not in self._clients:
                self._clients[name] = (
                    self._node.create_client(ListParameters, f'{name}/list_parameters'),
                    self._node.create_client(GetParameters, f'{name}/get_parameters'),
                )
            if all(client.service_is_ready() for client in self._clients[name]):
                self._asked.add(name)
                future = self._clients[name][0].call_async(ListParameters.Request())
                future.add_done_callback(partial(self._on_names, name))

    def missing(self) -> list[str]:
        """Nodes that are present but have not answered yet."""
        now = time.monotonic()
        return [
            name
            for name in sorted(self._present - self._answered)
            if now - self._seen[name] < ANSWER_TIMEOUT
        ]

    def _on_names(self, node: str, future: Future) -> None:
        names = list(future.result().result.names)
        answer = self._clients[node][1].call_async(GetParameters.Request(names=names))
        answer.add_done_callback(partial(self._on_values, node, names))

    def _on_values(self, node: str, names: list[str], future: Future) -> None:
        values = map(_plain, future.result().values)
        self._answered.add(node)
        self._found(node, dict(zip(names, values, strict=False)))

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node not in self._seen:  # of another robot, say: all nodes share the topic
            return
        values = {
            parameter.name: _plain(parameter.value) for parameter in event.changed_parameters
        }
        values |= {
            new.name: _plain(new.value) for new in event.new_parameters if new.name == MOTION
        }
        values = {key: value for key, value in values.items() if key not in OTHERS}
        if values:
            self._changed(event.node, values)


def _plain(value: Any) -> Any:
    """A parameter value as plain data."""
    plain = parameter_value_to_python(value)
    if isinstance(plain, (bool, int, float, str, type(None))):
        return plain
    return [item.hex() if isinstance(item, bytes) else item for item in plain]
