"""Decisions without branches, rows of arrays, and single lanes, in kernels.

Lanes cannot branch: a kernel that is to run side by side computes both results and selects. What
only some lanes need is done lane by lane, see :func:`lanes_of`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_new_ref, lower_builtin
from numba.extending import intrinsic, overload, type_callable

from parallel_robot_base.boxed import BoxedType
from parallel_robot_base.kernel import kernel
from parallel_robot_base.vector_operators import pack, splat
from parallel_robot_base.vector_types import LanesType, VectorType, load, shape_of, store

_INT32 = ir.IntType(32)


def select(condition: Any, a: Any, b: Any) -> Any:
    """`a` where a condition holds, else `b`: numbers, vectors, lanes and tuples of them."""
    return a if condition else b


@type_callable(select)
def _type_of_select(context: Any) -> Any:
    return lambda condition, a, b: _selected(condition, a, b)


def _selected(condition: Any, a: Any, b: Any) -> Any:
    """Type of a selection; None if there is none."""
    if not isinstance(condition, (types.Boolean, LanesType, VectorType)):
        return None
    if isinstance(a, types.BaseTuple) and isinstance(b, types.BaseTuple):
        if len(a) != len(b):
            return None
        kinds = [_selected(condition, *pair) for pair in zip(a.types, b.types, strict=True)]
        return None if None in kinds else _tuple_like(a, kinds)
    vectors = [kind for kind in (condition, a, b) if isinstance(kind, VectorType)]
    if vectors:
        if len({kind.count for kind in vectors}) > 1:
            return None
        inner = _selected(*(_element(kind) for kind in (condition, a, b)))
        return None if inner is None else VectorType(vectors[0].count, inner)
    lanes = [kind for kind in (a, b, condition) if isinstance(kind, LanesType)]
    if lanes:
        scalar = _selected(types.boolean, *(_scalar(kind) for kind in (a, b)))
        fits = scalar is not None and all(
            kind.scalar == scalar for kind in (a, b) if isinstance(kind, LanesType)
        )
        return LanesType(lanes[0].count, scalar) if fits else None
    if isinstance(a, types.Number) and isinstance(b, types.Number):
        if isinstance(a, types.Integer) and isinstance(b, types.Integer):
            return types.int64
        return types.float64
    a, b = types.unliteral(a), types.unliteral(b)
    return a if a == b else None


def _tuple_like(kind: Any, kinds: list[Any]) -> Any:
    """Type of a tuple of the same class with other elements."""
    return types.BaseTuple.from_types(kinds, getattr(kind, 'instance_class', None))


def _scalar(kind: Any) -> Any:
    return kind.scalar if isinstance(kind, LanesType) else kind


def _element(kind: Any) -> Any:
    return kind.element if isinstance(kind, VectorType) else kind


@lower_builtin(select, types.Any, types.Any, types.Any)
def _select(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    result = _choose(context, builder, signature.args, values, signature.return_type)
    return impl_ret_new_ref(context, builder, signature.return_type, result)


def _choose(context: Any, builder: Any, kinds: Any, values: Any, to: Any) -> Any:
    (condition, a, b), (c, x, y) = kinds, values
    if isinstance(to, types.BaseTuple):
        parts = [
            _choose(
                context,
                builder,
                (condition, a.types[i], b.types[i]),
                (c, builder.extract_value(x, i), builder.extract_value(y, i)),
                to.types[i],
            )
            for i in range(len(to))
        ]
        return context.make_tuple(builder, to, parts)
    if isinstance(to, VectorType):
        parts = []
        for i in range(to.count):
            each = [
                builder.extract_value(value, i) if isinstance(kind, VectorType) else value
                for kind, value in zip(kinds, values, strict=True)
            ]
            parts.append(_choose(context, builder, tuple(map(_element, kinds)), each, to.element))
        return pack(context, builder, to, parts)
    if isinstance(to, LanesType):
        x, y = splat(context, builder, x, a, to), splat(context, builder, y, b, to)
        return builder.select(c, x, y)
    x, y = context.cast(builder, x, a, to), context.cast(builder, y, b, to)
    result = builder.select(c, x, y)
    context.nrt.incref(builder, to, result)
    return result


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


def _reduces(function: Any, instruction: str) -> None:
    @type_callable(function)
    def _type(context: Any) -> Any:
        return lambda x: x.element if isinstance(x, VectorType) else None

    @lower_builtin(function, VectorType)
    def _lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        result = builder.extract_value(values[0], 0)
        for i in range(1, signature.args[0].count):
            result = getattr(builder, instruction)(result, builder.extract_value(values[0], i))
        return result


@overload(every, strict=False)
def _every_of_array(condition: Any) -> Any:
    return (lambda condition: np.all(condition)) if isinstance(condition, types.Array) else None


@overload(some, strict=False)
def _some_of_array(condition: Any) -> Any:
    return (lambda condition: np.any(condition)) if isinstance(condition, types.Array) else None


_reduces(every, 'and_')
_reduces(some, 'or_')


@kernel
def clip(x: Any, low: Any, high: Any) -> Any:
    """`x` within its limits, element by element; NaN stays NaN."""
    return select(x > high, high, select(x < low, low, x))


def in_a_lane(condition: Any) -> bool:
    """Whether a condition holds in any lane: the only one on which lanes may branch."""
    return bool(np.any(condition))


@type_callable(in_a_lane)
def _type_of_in_a_lane(context: Any) -> Any:
    ours = (LanesType, types.Boolean)
    return lambda x: types.boolean if isinstance(x, ours) else None


@lower_builtin(in_a_lane, types.Boolean)
def _in_the_only_lane(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    return values[0]


@lower_builtin(in_a_lane, LanesType)
def _in_a_lane(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    count = signature.args[0].count
    bits = builder.bitcast(values[0], ir.IntType(count))
    return builder.icmp_unsigned('!=', bits, ir.Constant(bits.type, 0))


def _row(context: Any, builder: Any, kind: Any, value: Any, index: Any) -> Any:
    """Emit a pointer to a row of an array."""
    array = context.make_array(kind)(context, builder, value)
    shape = cgutils.unpack_tuple(builder, array.shape, kind.ndim)
    for length in shape[1:]:
        index = builder.mul(index, length)
    return builder.gep(array.data, [index])


def rows_for(value: Any, count: int) -> Any:
    """An array for `count` values of this type, one a row; lanes are its last axis."""
    raise NotImplementedError('only in kernels')


@overload(rows_for, strict=False)
def _rows_for(value: Any, count: int) -> Any:
    shape, scalar = shape_of(types.unliteral(value))
    dtype = np.int64 if isinstance(scalar, types.Integer) else np.float64
    if len(shape) == 0:
        return lambda value, count: np.empty(count, dtype)
    if len(shape) == 1:
        (n,) = shape
        return lambda value, count: np.empty((count, n), dtype)
    n, lanes = shape
    return lambda value, count: np.empty((count, n, lanes), dtype)


def _holds(array: Any, value: Any) -> bool:
    """Whether a type is that of consecutive elements of an array."""
    if not isinstance(array, types.Array) or array.layout != 'C':
        return False
    return bool(shape_of(value)[1] == array.dtype)


@intrinsic
def read_row(context: Any, array: Any, index: Any, like: Any) -> Any:
    """Row `index` of an array as a value of the type of `like`; neither is checked.

    A row of shape (n,) is a vector, one of shape (n, lanes) a vector of lanes.
    """
    if not _holds(array, like):
        return None
    signature = like(array, types.intp, like)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = _row(context, builder, array, values[0], values[1])
        return load(context, builder, like, pointer)

    return signature, generate


@intrinsic
def write_row(context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write a number, a vector or lanes to row `index` of an array; neither is checked."""
    value = types.unliteral(value)
    ours = isinstance(value, (VectorType, LanesType))
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


@intrinsic
def lane(context: Any, value: Any, index: Any) -> Any:
    """What a number, a vector, or a tuple of them, boxed or not, is in one lane."""
    to = _in_one(value)
    signature = to(value, types.intp)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _extract(context, builder, value, values[0], values[1])

    return signature, generate


def _in_one(kind: Any) -> Any:
    if isinstance(kind, BoxedType):
        return _in_one(kind.content)
    if isinstance(kind, LanesType):
        return kind.scalar
    if isinstance(kind, VectorType):
        return VectorType(kind.count, _in_one(kind.element))
    if isinstance(kind, types.BaseTuple):
        return _tuple_like(kind, list(map(_in_one, kind.types)))
    return kind


def _extract(context: Any, builder: Any, kind: Any, value: Any, index: Any) -> Any:
    if isinstance(kind, BoxedType):
        pointer = context.get_value_type(kind.content).as_pointer()
        content = builder.load(builder.bitcast(value, pointer))
        return _extract(context, builder, kind.content, content, index)
    if isinstance(kind, LanesType):
        return builder.extract_element(value, index)
    if isinstance(kind, VectorType):
        elements = [
            _extract(context, builder, kind.element, builder.extract_value(value, i), index)
            for i in range(kind.count)
        ]
        return pack(context, builder, _in_one(kind), elements)
    if isinstance(kind, types.BaseTuple):
        elements = [
            _extract(context, builder, each, builder.extract_value(value, i), index)
            for i, each in enumerate(kind.types)
        ]
        return context.make_tuple(builder, _in_one(kind), elements)
    context.nrt.incref(builder, kind, value)
    return value


@intrinsic
def with_lane(context: Any, value: Any, index: Any, one: Any) -> Any:
    """A value with another one in one lane; the other one itself where there are no lanes."""
    signature = value(value, types.intp, one)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _insert(context, builder, value, one, values)

    return signature, generate


def _insert(context: Any, builder: Any, kind: Any, one: Any, values: Any) -> Any:
    value, index, given = values
    if isinstance(kind, LanesType):
        cast = context.cast(builder, given, one, kind.scalar)
        return builder.insert_element(value, cast, index)
    if isinstance(kind, VectorType):
        kinds, others = [kind.element] * kind.count, [one.element] * kind.count
    elif isinstance(kind, types.BaseTuple):
        kinds, others = kind.types, one.types
    else:
        return context.cast(builder, given, one, kind)
    result = value
    for i, (each, other) in enumerate(zip(kinds, others, strict=True)):
        parts = (builder.extract_value(value, i), index, builder.extract_value(given, i))
        part = _insert(context, builder, each, other, parts)
        result = builder.insert_value(result, part, i)
    return result


@intrinsic
def lanes_of(context: Any, value: Any) -> Any:
    """Number of lanes of a number; 1 of one that has none."""
    count = value.count if isinstance(value, LanesType) else 1

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return context.get_constant(types.intp, count)

    return types.intp(value), generate
