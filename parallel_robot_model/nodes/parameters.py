"""Parameters of a node that are keys of the configuration: read, declared, changed."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.configuration.loop import WAIT, LoopParameters
from parallel_robot_model.configuration.yaml_file import is_configuration
from parallel_robot_model.nodes.background import Background

START = 'start_stamp'  # the one parameter that every node takes while it runs, once


def overrides(node: Node) -> dict[str, Any]:
    """What the configuration of a node was given on its command line or in parameter files."""
    return {
        key: plain(parameter.value)
        for key, parameter in node.get_parameters_by_prefix('').items()
        if is_configuration(key)
    }


def describe(field: Field, value: Any, read_only: bool) -> ParameterDescriptor:
    """Descriptor of a parameter with unit, meaning and range.

    Args:
        field: What is known of the parameter.
        value: One of its values, for the type.
        read_only: Whether it is fixed. An empty list has no type, so that one may become of any.
    """
    text = field.description + (f' [{field.unit}]' if field.unit else '')
    untyped = isinstance(value, list) and not (value and read_only)
    descriptor = ParameterDescriptor(description=text, read_only=read_only, dynamic_typing=untyped)
    if isinstance(value, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(field.low), to_value=float(field.high))
        ]
    elif isinstance(value, int) and not isinstance(value, bool) and field.low > -math.inf:
        high = min(field.high, 2**63 - 1)
        descriptor.integer_range = [
            IntegerRange(from_value=int(field.low), to_value=int(high), step=1)
        ]
    return descriptor


def declare(node: Node, key: str, field: Field, value: Any, read_only: bool) -> None:
    """Declare a parameter of a node with unit, meaning and range."""
    if node.has_parameter(key):  # it may be an integer where a float is meant
        node.undeclare_parameter(key)
    value = list(value) if isinstance(value, tuple) else value
    descriptor = describe(field, value, read_only)
    node.declare_parameter(key, value, descriptor, ignore_override=True)


def declare_text(node: Node, key: str, text: str, description: str) -> None:
    """Declare an informational, read-only parameter, for bags; again when it has changed."""
    if node.has_parameter(key):  # or from the parameters of another run
        node.describe_parameter(key).read_only = False  # else rclpy would keep it
        node.undeclare_parameter(key)
    descriptor = ParameterDescriptor(description=description, read_only=True)
    node.declare_parameter(key, text, descriptor, ignore_override=True)


def split(node: Node, wanted: Iterable[Parameter]) -> tuple[list[Parameter], dict[str, Any]]:
    """Split a request to set parameters of a node.

    Fixed parameters that shall keep the value they have are left out, so that a file of all
    parameters can be loaded.

    Returns:
        Parameters of ROS, and key to value of the suite's or unknown ones.
    """
    of_ros, changes = [], {}
    for parameter in wanted:
        name, value = parameter.name, plain(parameter.value)
        if node.has_parameter(name):
            own = plain(node.get_parameter(name).value)
            value = _meant(own, value)
            if value == own and (name == START or not node.is_settable(name)):
                continue
        if node.has_parameter(name) and not is_configuration(name):
            of_ros.append(parameter)
        else:
            changes[name] = value
    return of_ros, changes


def plain(value: Any) -> Any:
    """Value of a parameter; arrays as lists."""
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def _meant(own: Any, value: Any) -> Any:
    """What is meant by a value that rclpy read in a file, or `ros2 param set` on its command line.

    Their YAML takes a number without a dot, as 7e-05, for a text, and the text off for false.
    """
    if isinstance(own, str):
        return own if not isinstance(value, str) and _read(own) == value else value
    if isinstance(own, float) or (isinstance(own, list) and own and isinstance(own[0], float)):
        read = [_read(item) for item in value] if isinstance(value, list) else _read(value)
        items = read if isinstance(read, list) else [read]
        return read if all(isinstance(item, (int, float)) for item in items) else value
    return value


def _read(value: Any) -> Any:
    """What a text is in YAML, or as a number without a dot; other values as they are."""
    try:
        return plain_data.load(value) if isinstance(value, str) else value
    except ValueError:
        return value


class CommonStart:
    """The stamp of t = 0, which a node that waits for it is sent once."""

    def __init__(self, loop: LoopParameters) -> None:
        """Wait for the stamp, if the parameters of the loop say so."""
        self._loop = loop
        self._stamp: int | None = None

    def check(self, stamp: Any) -> None:
        """Check a stamp [ns]; the one that the node already has is right: it was sent twice.

        Raises:
            InputError: the node does not wait for a start, the stamp is not on the grid of the
                period, or it lies in the past.
        """
        if self._stamp is not None and stamp == self._stamp:
            return
        if self._loop.start_stamp != WAIT or self._stamp is not None:
            raise InputError('the node does not wait for a start')
        if not isinstance(stamp, int) or stamp <= 0 or stamp % self._loop.period_ns:
            raise InputError(
                f'start_stamp must be a whole multiple of the period in ns, not {stamp!r}'
            )
        if not self._loop.lockstep and stamp <= time.time_ns():
            raise InputError(f'start_stamp {stamp} lies in the past')

    def take(self, stamp: int) -> bool:
        """Take a checked stamp [ns].

        Returns:
            Whether it is new.
        """
        new = stamp != self._stamp
        self._stamp = stamp
        return new


# Parameter services that limit the size of a request, and take it as a whole or not at all.

MAX_NAMES = 1000  # in one request; a node has some hundred parameters
MAX_PREFIXES = 100  # in one request
MAX_NAME_LENGTH = 256  # characters
MAX_VALUE_LENGTH = 4096  # characters or numbers: a path, the names of joints
ARRAYS = ('byte_array', 'bool_array', 'integer_array', 'double_array', 'string_array')
TYPES = tuple(kind.value for kind in Parameter.Type if kind != Parameter.Type.NOT_SET)


class BoundedParameterService(ParameterService):  # type: ignore[misc]
    """Parameter services of a node whose loop must not be held up.

    The parameters of one request are set together or not at all, because gains are checked as a
    set; rclpy would set them one after the other and stop half-way. A request that is too large
    is not read; it is answered as rclpy answers one for parameters that do not exist.
    """

    def __init__(self, node: Node, background: Background) -> None:
        """Offer the services; the background answers them."""
        others = set(node.services)
        super().__init__(node)
        for service in set(node.services) - others:
            background.answer(service)

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        result = set_together(self._get_node(), request.parameters)
        response.results = [result] * min(len(request.parameters), MAX_NAMES)
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = set_together(self._get_node(), request.parameters)
        return response

    def _get_parameters_callback(self, request: Any, response: Any) -> Any:
        few = len(request.names) <= MAX_NAMES
        return super()._get_parameters_callback(request, response) if few else response

    def _get_parameter_types_callback(self, request: Any, response: Any) -> Any:
        few = len(request.names) <= MAX_NAMES
        return super()._get_parameter_types_callback(request, response) if few else response

    def _describe_parameters_callback(self, request: Any, response: Any) -> Any:
        few = len(request.names) <= MAX_NAMES
        return super()._describe_parameters_callback(request, response) if few else response

    def _list_parameters_callback(self, request: Any, response: Any) -> Any:
        few = len(request.prefixes) <= MAX_PREFIXES
        return super()._list_parameters_callback(request, response) if few else response


def set_together(node: Node, messages: Sequence[ParameterMessage]) -> SetParametersResult:
    """Set the parameters of a request: all, or none with the reason."""
    try:
        changed = read(messages)
    except InputError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return node.set_parameters_atomically(changed)


def read(messages: Sequence[ParameterMessage]) -> list[Parameter]:
    """Read the parameters of a request.

    Raises:
        InputError: there are too many, one is named twice or too long, or has no known type.
    """
    if not messages:
        return []
    if len(messages) > MAX_NAMES:
        raise InputError(
            f'{len(messages)} parameters in one request; at most {MAX_NAMES} are read'
        )
    for message in messages:
        name = message.name
        if len(name) > MAX_NAME_LENGTH:
            raise InputError(
                f'a name of {len(name)} characters; at most {MAX_NAME_LENGTH} are read'
            )
        if message.value.type not in TYPES:
            raise InputError(f'{name!r} has a value of unknown type {message.value.type}')
        if not _size(message.value) <= MAX_VALUE_LENGTH:
            raise InputError(f'{name!r} has a value longer than {MAX_VALUE_LENGTH}')
    name, times = Counter(message.name for message in messages).most_common(1)[0]
    if times > 1:
        raise InputError(f'{name!r} is named twice')
    return [Parameter.from_parameter_msg(message) for message in messages]


def _size(value: Any) -> int:
    """Characters of a text, or numbers or characters of a list."""
    texts = [value.string_value, *value.string_array_value]
    return sum(map(len, texts)) + sum(len(getattr(value, f'{kind}_value')) for kind in ARRAYS)
