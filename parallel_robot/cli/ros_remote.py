"""Another node, asked for its parameters and services by name; for users without ROS tools."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_srvs.srv import Trigger

from parallel_robot_model.common.errors import InputError, RunError, printable
from parallel_robot_model.nodes.middleware import tool_node
from parallel_robot_model.processes import realtime

HEARD = 5.0  # s, in which a node must be heard
POLL = 0.05  # s, between two looks
ANSWERED = 10.0  # s, in which it must answer
NOT_SET = ParameterType.PARAMETER_NOT_SET
TRIGGER = 'std_srvs/srv/Trigger'
DOUBLES = (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_DOUBLE_ARRAY)


class Remote:
    """Asks one node; made by :func:`remote`."""

    def __init__(self, own: Node, name: str) -> None:
        """Prepare; `own` asks the node of that full name."""
        self._own, self.name = own, name

    def names(self) -> list[str]:
        """Names of its parameters, in order."""
        return sorted(self._wait(self._parameters().list_parameters()).result.names)

    def values(self, names: Iterable[str]) -> dict[str, Any]:
        """Some of its parameters by name.

        Raises:
            InputError: it has none of a name.
        """
        asked = list(names)
        answer = self._wait(self._parameters().get_parameters(asked)).values
        if len(answer) != len(asked) or any(value.type == NOT_SET for value in answer):
            missing = sorted(set(asked) - set(self.names()))
            raise InputError(f'{self.name} has no parameter {", ".join(missing)}')
        pairs = zip(asked, answer, strict=True)
        return {name: parameter_value_to_python(value) for name, value in pairs}

    def set(self, values: Mapping[str, Any]) -> None:
        """Set several of its parameters, all or none; whole numbers become what it has.

        Raises:
            InputError: the node refuses them.
        """
        client = self._parameters()
        types = self._wait(client.get_parameter_types(list(values))).types
        if len(types) != len(values):  # it does not know all names, and says so when they are set
            types = [NOT_SET] * len(values)
        typed = [
            _parameter(name, _as_doubles(value) if kind in DOUBLES else value)
            for (name, value), kind in zip(values.items(), types, strict=True)
        ]
        result = self._wait(client.set_parameters_atomically(typed)).result
        if not result.successful:
            raise InputError(f'{self.name} refuses: {result.reason}')

    def call(self, service: str) -> tuple[bool, str]:
        """Ask one of its services without arguments: whether it did so, and what it says.

        Raises:
            InputError: it has no such service, or one of another type.
        """
        deadline = time.monotonic() + HEARD
        while service not in (own := self._services()) and time.monotonic() < deadline:
            rclpy.spin_once(self._own, timeout_sec=POLL)  # it may be heard after its node
        if service not in own:
            known = ', '.join(name for name, kind in sorted(own.items()) if kind == TRIGGER)
            raise InputError(f'{self.name} has no service {service}; without arguments: {known}')
        if own[service] != TRIGGER:
            raise InputError(f'{self.name}/{service} is of {own[service]}, not {TRIGGER}')
        client = self._own.create_client(Trigger, f'{self.name}/{service}')
        if not client.wait_for_service(HEARD):
            raise RunError(f'{self.name}/{service} is not heard')
        answer = self._wait(client.call_async(Trigger.Request()))
        return bool(answer.success), str(answer.message)

    def _services(self) -> dict[str, str]:
        """Types of the services whose names begin with that of the node, by the rest."""
        head = f'{self.name}/'
        every = self._own.get_service_names_and_types()
        return {name[len(head) :]: kind for name, (kind, *_) in every if name.startswith(head)}

    def _parameters(self) -> AsyncParameterClient:
        client = AsyncParameterClient(self._own, self.name)
        if not client.wait_for_services(HEARD):
            raise RunError(f'{self.name} does not answer for its parameters')
        return client

    def _wait(self, future: Future) -> Any:
        rclpy.spin_until_future_complete(self._own, future, timeout_sec=ANSWERED)
        if not future.done():
            raise RunError(f'{self.name} does not answer within {ANSWERED:g} s')
        return future.result()


@contextmanager
def remote(name: str) -> Iterator[Remote]:
    """Find a node.

    Args:
        name: Its name, with its namespace if it has one.

    Raises:
        RunError: it is not heard; those that are, are named.
    """
    full = f'/{name.strip("/")}'
    realtime.prepare_discovery()
    with tool_node('parallel_robot_param', enable_rosout=False) as own:
        deadline = time.monotonic() + HEARD
        while full not in (heard := _heard(own)):
            if time.monotonic() > deadline:
                others = ', '.join(heard) or 'none'
                raise RunError(f'no node {full} is heard; those that are: {others}')
            rclpy.spin_once(own, timeout_sec=POLL)
        yield Remote(own, full)


def _heard(own: Node) -> list[str]:
    places = own.get_node_names_and_namespaces()
    names = {f'{space.rstrip("/")}/{name}' for name, space in places}
    return sorted(names - {own.get_fully_qualified_name()})


def _parameter(name: str, value: Any) -> Parameter:
    """A parameter of ROS.

    Raises:
        InputError: ROS has none of such a value.
    """
    items = value if isinstance(value, list) else [value]
    try:
        if any(isinstance(item, int) and item.bit_length() > 63 for item in items):
            raise TypeError
        return Parameter(name, value=value)
    except TypeError:
        shown = printable(repr(value))
        raise InputError(
            f'{name} cannot be {shown}: a parameter of ROS is a number of 64 bits, a text, true '
            'or false, or a list of one of these'
        ) from None


def _as_doubles(value: Any) -> Any:
    """Whole numbers as floating-point ones, alone or in a list."""
    if isinstance(value, list):
        return [_as_doubles(item) for item in value]
    return float(value) if type(value) is int else value
