"""Parameter services that limit the size of a request, and take it as a whole or not at all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.nodes.background import Background

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
