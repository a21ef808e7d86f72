"""Other nodes as their client sees them: services, parameters, diagnostics, the graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces import srv
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import Trigger

SLICE = 0.2  # s, between two calls of `watch` while an answer is waited for
OF_PARAMETERS = {  # types of the services that every node has for its parameters
    'list_parameters': srv.ListParameters,
    'get_parameters': srv.GetParameters,
    'get_parameter_types': srv.GetParameterTypes,
    'describe_parameters': srv.DescribeParameters,
    'set_parameters': srv.SetParameters,
    'set_parameters_atomically': srv.SetParametersAtomically,
}


class Services(dict[str, Client]):
    """Clients of services by name, made when they are first looked up.

    Those that are not of parameters have no arguments.
    """

    def __init__(self, node: Node) -> None:
        """Prepare; `node` asks."""
        super().__init__()
        self._node = node

    def __missing__(self, name: str) -> Client:
        """Make a client."""
        kind = OF_PARAMETERS.get(name.rpartition('/')[2], Trigger)
        client = self[name] = self._node.create_client(kind, name)
        return client

    def clear(self) -> None:
        """Destroy all clients."""
        for client in self.values():
            self._node.destroy_client(client)
        super().clear()

    def ready(self, *names: str) -> bool:
        """Whether some services are there; a client of each is made."""
        clients = [self[name] for name in names]
        return all(client.service_is_ready() for client in clients)

    def send(self, name: str, take: Callable[[Any], None] | None = None, **fields: Any) -> Future:
        """Ask a service with the fields of its request; `take` gets the answer."""
        client = self[name]
        future = client.call_async(client.srv_type.Request(**fields))
        if take is not None:
            future.add_done_callback(lambda done: take(done.result()))
        return future

    def call(
        self,
        name: str,
        wait: float,
        seconds: float,
        watch: Callable[[], None] = lambda: None,
        **fields: Any,
    ) -> Any:
        """The answer of a service; None if there is none in time.

        Args:
            name: Its name.
            wait: How long the service may be away [s].
            seconds: How long its answer may take [s].
            watch: Called again and again while the answer is waited for; raises to give up.
            fields: Of the request.
        """
        watch()
        if not self[name].wait_for_service(wait):
            return None
        future, deadline = self.send(name, **fields), time.monotonic() + seconds
        while not future.done() and time.monotonic() < deadline:
            rclpy.spin_until_future_complete(self._node, future, timeout_sec=SLICE)
            watch()
        return future.result() if future.done() else None

    def read_parameters(self, node: str, take: Callable[[dict[str, Any]], None]) -> None:
        """Ask a node for all of its parameters; `take` gets their values by name."""

        def read(answer: Any) -> None:
            names = list(answer.result.names)
            self.send(
                f'{node}/get_parameters', lambda found: take(values_of(names, found)), names=names
            )

        self.send(f'{node}/list_parameters', read)


def values_of(names: list[str], answer: Any) -> dict[str, Any]:
    """Values of parameters by name, of an answer that has them in that order."""
    return dict(zip(names, map(plain, answer.values), strict=False))


def plain(value: Any) -> Any:
    """A parameter value as plain data."""
    found = parameter_value_to_python(value)
    if isinstance(found, bool | int | float | str | None):
        return found
    return [item.hex() if isinstance(item, bytes) else item for item in found]


def messages_of(values: Mapping[str, Any]) -> list[Any]:
    """Parameters as messages.

    Raises:
        TypeError: ROS has no type for a value.
    """
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


def reported(status: DiagnosticStatus) -> dict[str, str]:
    """What a node reports of itself, key to value."""
    return {item.key: item.value for item in status.values}
