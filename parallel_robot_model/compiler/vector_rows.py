"""Rows of arrays as values, in kernels: vectors and numbers are read and written whole."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types

from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels
from parallel_robot_model.compiler.vectors import Vector, VectorType, load, shape_of, store


def _row(context: Any, builder: Any, kind: Any, value: Any, index: Any) -> Any:
    """Emit a pointer to a row of an array."""
    array = context.make_array(kind)(context, builder, value)
    shape = cgutils.unpack_tuple(builder, array.shape, kind.ndim)
    for length in shape[1:]:
        index = builder.mul(index, length)
    return builder.gep(array.data, [index])


def _holds(array: Any, value: Any) -> bool:
    """Whether a type is that of consecutive elements of an array."""
    if not isinstance(array, types.Array) or array.layout != 'C':
        return False
    return bool(shape_of(value)[1] == array.dtype)


def _elements(array: Any, index: int, count: int) -> Any:
    """The elements from the beginning of a row on."""
    start = int(index) * math.prod(array.shape[1:])
    return array.reshape(-1)[start : start + count]


def read_row(array: Any, index: int, like: Any) -> Any:
    """Row `index` of an array as a value of the type of `like`; neither is checked."""
    numbers = _elements(array, index, np.size(like))
    return numbers.reshape(like.shape).copy().view(Vector) if np.ndim(like) else numbers[0]


def write_row(array: Any, index: int, value: Any) -> None:
    """Write a number or a vector to row `index` of an array; neither is checked."""
    _elements(array, index, np.size(value))[:] = np.ravel(value)


@in_kernels(read_row)
def _read_row(context: Any, array: Any, index: Any, like: Any) -> Any:
    if not _holds(array, like):
        return None
    signature = like(array, types.intp, like)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = _row(context, builder, array, values[0], values[1])
        return load(context, builder, like, pointer)

    return signature, generate


@in_kernels(write_row)
def _write_row(context: Any, array: Any, index: Any, value: Any) -> Any:
    value = types.unliteral(value)
    ours = isinstance(value, VectorType)
    if not _holds(array, value if ours else array.dtype) or not array.mutable:
        return None
    signature = types.none(array, types.intp, value)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = _row(context, builder, array, values[0], values[1])
        if ours:
            store(context, builder, value, values[2], pointer)
        else:
            given = context.cast(builder, values[2], value, array.dtype)
            store(context, builder, array.dtype, given, pointer)
        return context.get_dummy_value()

    return signature, generate
