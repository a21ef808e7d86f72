"""Whole vectors in kernels: rows of arrays, decisions without branches, copies as arrays."""

from __future__ import annotations

import functools
import math
import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload
from numba.np.numpy_support import as_dtype

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler.kernels import internal, kernel
from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels
from parallel_robot_model.compiler.vectors import (
    Emitted,
    Vector,
    VectorType,
    aligned,
    as_arrays,
    as_vectors,
    element_of,
    emit,
    load,
    on_vectors,
    packed,
    rows_of,
    shape_of,
    store,
    through,
    tuple_like,
)

# Rows of arrays as values, in kernels: vectors and numbers are read and written whole.


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


def read_row(array: Any, index: int, template: Any) -> Any:
    """Row `index` of an array as a value of the type of `template`; neither is checked."""
    numbers = _elements(array, index, np.size(template))
    return numbers.reshape(template.shape).copy().view(Vector) if np.ndim(template) else numbers[0]


def write_row(array: Any, index: int, value: Any) -> None:
    """Write a number or a vector to row `index` of an array; neither is checked."""
    _elements(array, index, np.size(value))[:] = np.ravel(value)


@in_kernels(read_row)
def _read_row(context: Any, array: Any, index: Any, template: Any) -> Any:
    if not _holds(array, template):
        return None
    signature = template(array, types.intp, template)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = _row(context, builder, array, values[0], values[1])
        return load(context, builder, template, pointer)

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


# Decisions without branches, in kernels: both results are computed, and one is taken.


def select(condition: Any, a: Any, b: Any) -> Any:
    """`a` where a condition holds, else `b`: numbers, vectors and tuples of them."""
    if isinstance(a, tuple):
        return through(functools.partial(select, condition), a, b)
    if isinstance(condition, np.ndarray):
        chosen = np.where(*aligned((condition, a, b)))
        return chosen.view(type(condition))
    return a if condition else b


def _selected(condition: Any, a: Any, b: Any) -> Any:
    """Type of a selection; None if there is none."""
    if not isinstance(condition, (types.Boolean, VectorType)):
        return None
    if isinstance(a, types.BaseTuple) and isinstance(b, types.BaseTuple):
        if len(a) != len(b):
            return None
        kinds = [_selected(condition, *pair) for pair in zip(a.types, b.types, strict=True)]
        return None if None in kinds else tuple_like(a, kinds)
    if isinstance(a, VectorType) and a == b and a.count == 0:
        return a  # the memory of a law that has none
    vectors = [kind for kind in (condition, a, b) if isinstance(kind, VectorType)]
    if vectors:
        if len({kind.count for kind in vectors}) > 1:
            return None
        inner = _selected(*map(element_of, (condition, a, b)))
        return None if inner is None else VectorType(vectors[0].count, inner)
    if isinstance(a, types.Number) and isinstance(b, types.Number):
        if isinstance(a, types.Integer) and isinstance(b, types.Integer):
            return types.int64
        return types.float64
    a, b = types.unliteral(a), types.unliteral(b)
    return a if a == b else None


@on_vectors(select, (types.Any,) * 3)
def _select(context: Any, *kinds: Any) -> Any:
    to = _selected(*kinds)
    return to, functools.partial(_choose, to)


def _choose(to: Any, condition: Emitted, a: Emitted, b: Emitted) -> Any:
    if isinstance(to, types.BaseTuple):
        parts = zip(to.types, a, b, strict=True)
        return [_choose(kind, condition, *pair) for kind, *pair in parts]
    if isinstance(to, VectorType):
        return [_choose(to.element, *row) for row in rows_of(condition, a, b)]
    (context, builder), c = condition.place, condition.value
    x, y = packed(context, builder, to, a), packed(context, builder, to, b)
    chosen = builder.select(c, x, y)
    context.nrt.incref(builder, to, chosen)
    return Emitted(context, builder, to, chosen)


@overload(select, strict=False)
def _select_of_arrays(condition: Any, a: Any, b: Any) -> Any:
    if isinstance(condition, types.Array):
        return lambda condition, a, b: np.where(condition, a, b)
    return None


def every(condition: Any) -> Any:
    """Whether a condition holds for all elements of a vector."""
    return np.all(condition)


def some(condition: Any) -> Any:
    """Whether a condition holds for an element of a vector."""
    return np.any(condition)


@on_vectors(every, (VectorType,))
def _every(context: Any, x: Any) -> Any:
    return x.element, functools.partial(functools.reduce, functools.partial(emit, operator.and_))


@on_vectors(some, (VectorType,))
def _some(context: Any, x: Any) -> Any:
    return x.element, functools.partial(functools.reduce, functools.partial(emit, operator.or_))


@overload(every, strict=False)
def _every_of_array(condition: Any) -> Any:
    return (lambda condition: np.all(condition)) if isinstance(condition, types.Array) else None


@overload(some, strict=False)
def _some_of_array(condition: Any) -> Any:
    return (lambda condition: np.any(condition)) if isinstance(condition, types.Array) else None


@kernel
def clip(x: Any, low: Any, high: Any) -> Any:
    """`x` within its limits, element by element; NaN stays NaN."""
    return select(x > high, high, select(x < low, low, x))


@kernel
def largest(x: Any) -> Any:
    """Largest magnitude of the elements of a vector or an array of one dimension."""
    largest = abs(x[0])
    for i in range(1, len(x)):
        largest = max(largest, abs(x[i]))
    return largest


@internal
def is_finite(x: Array) -> bool:
    """Whether all elements of a vector are finite."""
    return every(x - x == 0.0)


# Vectors as arrays and back, in tuples of any kind: for functions that change or slice them.


def arrays_of(value: Any) -> Any:
    """A value with new arrays in place of its vectors."""
    return as_arrays(value)


def vectors_of(value: Any, template: Any) -> Any:
    """A value of the type of `template`, with vectors in place of its arrays.

    One of another size is not read: floats become NaN.
    """
    return as_vectors(value)


def _with_arrays(kind: Any) -> Any:
    """Type of a value with arrays in place of its vectors."""
    if isinstance(kind, types.BaseTuple):
        return tuple_like(kind, [_with_arrays(part) for part in kind])
    shape, scalar = shape_of(kind)
    return types.Array(scalar, len(shape), 'C') if shape else kind


@on_vectors(arrays_of)
def _arrays_of(context: Any, value: Any) -> Any:
    return _with_arrays(value), _array


@on_vectors(vectors_of)
def _vectors_of(context: Any, value: Any, template: Any) -> Any:
    return template if value == _with_arrays(template) else None, _vector


def _array(value: Emitted) -> Any:
    """Emit a value with arrays in place of its vectors."""
    if isinstance(value.kind, types.BaseTuple):
        return [_array(part) for part in value]
    if not isinstance(value.kind, VectorType):
        return value
    shape, scalar = shape_of(value.kind)
    dtype = as_dtype(scalar)

    def copied(x: Any) -> Any:
        copy = np.empty(shape, dtype)
        write_row(copy, 0, x)
        return copy

    return _called(copied, _with_arrays(value.kind), value)


def _vector(value: Emitted, template: Emitted) -> Any:
    """Emit a value of a type with vectors in place of its arrays."""
    if isinstance(template.kind, types.BaseTuple):
        return list(map(_vector, value, template))
    if not isinstance(template.kind, VectorType):
        return value
    shape, scalar = shape_of(template.kind)
    count = math.prod(shape)

    def floats(x: Any, template: Any) -> Any:
        return read_row(x, 0, template) if x.size == count else template * np.nan

    def others(x: Any, template: Any) -> Any:
        return read_row(x, 0, template) if x.size == count else template

    return _called(floats if scalar == types.float64 else others, template.kind, value, template)


def _called(function: Any, to: Any, *values: Emitted) -> Emitted:
    """Emit the call of a Python function that is compiled for it."""
    context, builder = values[0].place
    signature, given = to(*(each.kind for each in values)), [each.value for each in values]
    return Emitted(
        *values[0].place, to, context.compile_internal(builder, function, signature, given)
    )
