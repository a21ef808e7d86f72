"""Vectors as arrays and back, in tuples of any kind: for functions that change or slice them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.np.numpy_support import as_dtype

from parallel_robot_model.compiler.numba_parts import impl_ret_new_ref, in_kernels
from parallel_robot_model.compiler.vector_rows import read_row, write_row
from parallel_robot_model.compiler.vectors import (
    VectorType,
    as_arrays,
    as_vectors,
    shape_of,
    tuple_like,
)


def arrays_of(value: Any) -> Any:
    """A value with new arrays in place of its vectors."""
    return as_arrays(value)


def vectors_of(value: Any, like: Any) -> Any:
    """A value of the type of `like`, with vectors in place of its arrays.

    One of another size is not read: floats become NaN.
    """
    return as_vectors(value)


def _with_arrays(kind: Any) -> Any:
    """Type of a value with arrays in place of its vectors."""
    if isinstance(kind, types.BaseTuple):
        return tuple_like(kind, [_with_arrays(part) for part in kind])
    shape, scalar = shape_of(kind)
    return types.Array(scalar, len(shape), 'C') if shape else kind


@in_kernels(arrays_of)
def _arrays_of(context: Any, value: Any) -> Any:
    arrays = _with_arrays(value)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        made = _array(context, builder, value, values[0])
        return impl_ret_new_ref(context, builder, arrays, made)

    return arrays(value), generate


@in_kernels(vectors_of)
def _vectors_of(context: Any, value: Any, like: Any) -> Any:
    if value != _with_arrays(like):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _vector(context, builder, like, values[0], values[1])

    return like(value, like), generate


def _array(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Emit a value with arrays in place of its vectors."""
    if isinstance(kind, types.BaseTuple):
        parts = [
            _array(context, builder, part, builder.extract_value(value, k))
            for k, part in enumerate(kind)
        ]
        return context.make_tuple(builder, _with_arrays(kind), parts)
    if not isinstance(kind, VectorType):
        return value
    shape, scalar = shape_of(kind)
    dtype = as_dtype(scalar)

    def copied(x: Any) -> Any:
        copy = np.empty(shape, dtype)
        write_row(copy, 0, x)
        return copy

    return context.compile_internal(builder, copied, _with_arrays(kind)(kind), [value])


def _vector(context: Any, builder: Any, kind: Any, value: Any, like: Any) -> Any:
    """Emit a value of a type with vectors in place of its arrays."""
    if isinstance(kind, types.BaseTuple):
        parts = [
            _vector(
                context,
                builder,
                part,
                builder.extract_value(value, k),
                builder.extract_value(like, k),
            )
            for k, part in enumerate(kind)
        ]
        return context.make_tuple(builder, kind, parts)
    if not isinstance(kind, VectorType):
        return value
    shape, scalar = shape_of(kind)
    count = math.prod(shape)

    def floats(x: Any, like: Any) -> Any:
        return read_row(x, 0, like) if x.size == count else like * np.nan

    def others(x: Any, like: Any) -> Any:
        return read_row(x, 0, like) if x.size == count else like

    copied = floats if scalar == types.float64 else others
    signature = kind(_with_arrays(kind), kind)
    return context.compile_internal(builder, copied, signature, [value, like])
