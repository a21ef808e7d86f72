"""What is wrong with what the update of a law returns, field by field."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numba import typeof, types

from parallel_robot_control.contract import ControlOutput
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import plain_type, shape_of

CALL = f'ControlOutput({", ".join(ControlOutput._fields)})'
MAX_TYPE_LENGTH = 60  # characters of the name of a type


def wrong_types(returned: Any, wanted: Any) -> str:
    """Which fields of an output have a wrong type, what they are and should be; or nothing.

    Args:
        returned: Numba's type of what an update returns.
        wanted: That of a right output.
    """
    if getattr(returned, 'instance_class', None) is not ControlOutput:
        return f'update must return {CALL}, not {_named(returned)}'
    mistakes = [
        f'{field} as {_named(given)}, not {_named(right)}'
        for each in zip(ControlOutput._fields, returned.types, wanted.types, strict=True)
        for field, given, right in _different(*each)
    ]
    return f'update returns {"; ".join(mistakes)}' if mistakes else ''


def wrong_shapes(output: ControlOutput, joints: int, memory: Any) -> str:
    """Which fields of an output have a wrong shape, and the right one; or nothing.

    Args:
        output: The output.
        joints: Number of the joints, n.
        memory: Memory before the first update.
    """
    row = np.zeros(joints)
    right = dict(leaves('', ControlOutput(row, row, row, memory)))
    mistakes = [
        f'{field} of shape {np.shape(value)}, not {np.shape(right[field])}'
        for field, value in leaves('', output)
        if np.shape(value) != np.shape(right[field])
    ]
    return f'update returns {"; ".join(mistakes)}' if mistakes else ''


def wrong_memory(memory: Any) -> str:
    """Which fields of a memory cannot be kept, and what can; or nothing.

    Args:
        memory: Memory before the first update, with vectors.
    """
    mistakes = [
        f'{field} is {_named(typeof(value))}'
        for field, value in leaves('memory', memory)
        if plain_type(value) is None
    ]
    kept = 'numbers and arrays of float64, int64 or bool'
    return f'{", ".join(mistakes)}, but a memory is made of {kept}' if mistakes else ''


def leaves(name: str, value: Any) -> Iterator[tuple[str, Array | float]]:
    """The numbers and arrays in a tuple of tuples, each with its name, e.g. memory.integral."""
    if isinstance(value, tuple):
        for field, part in zip(_fields(value, len(value)), value, strict=True):
            yield from leaves(f'{name}.{field}'.removeprefix('.'), part)
    else:
        yield name, value


def _different(name: str, given: Any, right: Any) -> Iterator[tuple[str, Any, Any]]:
    """The innermost fields in which two types differ, each with both types."""
    classes = [getattr(kind, 'instance_class', None) for kind in (given, right)]
    tuples = isinstance(given, types.BaseTuple) and isinstance(right, types.BaseTuple)
    if tuples and classes[0] is classes[1] and len(given) == len(right):
        parts = zip(_fields(right, len(right)), given.types, right.types, strict=True)
        for field, *pair in parts:
            yield from _different(f'{name}.{field}', *pair)
    elif given != right:
        yield name, given, right


def _fields(group: Any, count: int) -> tuple[Any, ...]:
    """Names of the fields of a NamedTuple or of its type; numbers for another tuple."""
    return getattr(group, '_fields', None) or getattr(group, 'fields', None) or (*range(count),)


def _named(kind: Any) -> str:
    """A type in words."""
    shape, scalar = shape_of(kind)
    if shape:
        return f'a vector of shape {shape} of {scalar}'
    if isinstance(kind, types.Array):
        strided = '' if kind.layout == 'C' else ' with gaps (take a .copy())'
        return f'a {kind.ndim}-d array of {kind.dtype}{strided}'
    if isinstance(kind, types.Number | types.Boolean):
        return f'a number ({kind})'
    if isinstance(kind, types.BaseTuple):
        made_by = getattr(kind, 'instance_class', None)
        return made_by.__name__.rpartition('.')[2] if made_by else f'a tuple of {len(kind)}'
    text = 'None' if isinstance(kind, types.NoneType) else str(kind)
    return text if len(text) <= MAX_TYPE_LENGTH else f'{text[:MAX_TYPE_LENGTH]}...'
