"""Single lanes, in kernels: what cannot be selected is done lane by lane.

A number without lanes counts as one lane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin
from numba.extending import intrinsic, type_callable

from parallel_robot_compiler.boxed import BoxedType
from parallel_robot_compiler.vector_operators import pack
from parallel_robot_compiler.vector_types import (
    LanesType,
    VectorType,
    tuple_like,
)

_INT32 = ir.IntType(32)


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
        return tuple_like(kind, list(map(_in_one, kind.types)))
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
