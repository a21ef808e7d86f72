"""Whole vectors in kernels: how they are made, read and reduced.

Registered with Numba are ``vector``, ``len``, indices, ``@``, ``np.sum``, ``np.roll``,
``np.diag``, ``np.transpose`` and ``np.zeros_like``.
"""

from __future__ import annotations

import functools
import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels
from parallel_robot_model.compiler.vectors import (
    VectorType,
    element_of,
    elementwise,
    on_vectors,
    vector,
)

NONE = None, None  # no result


@in_kernels(len, (VectorType,))
def _len(context: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return context.get_constant(types.intp, x.count)

    return types.intp(x), generate


@in_kernels(operator.getitem, (VectorType, types.Integer), (VectorType, types.BaseTuple))
def _item(context: Any, x: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        value, at = values
        if not isinstance(index, types.BaseTuple):
            return _at(context, builder, x, value, index, at)
        row = _at(context, builder, x, value, index[0], builder.extract_value(at, 0))
        return _at(context, builder, x.element, row, index[1], builder.extract_value(at, 1))

    if not isinstance(index, types.BaseTuple):
        return x.element(x, index), generate
    return (element_of(x.element)(x, index), generate) if len(index) == 2 else None


def _at(context: Any, builder: Any, kind: Any, value: Any, index: Any, at: Any) -> Any:
    """Emit an element; the index counts modulo the size, so nothing beyond it can be read."""
    if not kind.count:
        return ir.Constant(context.get_value_type(kind.element), None)
    if isinstance(index, types.IntegerLiteral):
        return builder.extract_value(value, index.literal_value % kind.count)
    at = context.cast(builder, at, index, types.intp)
    count = context.get_constant(types.intp, kind.count)
    at = builder.srem(builder.add(builder.srem(at, count), count), count)
    slot = cgutils.gep_inbounds(builder, cgutils.alloca_once_value(builder, value), 0, at)
    return builder.load(slot)


@on_vectors(vector, (types.BaseTuple,), (VectorType,))
def _vector(context: Any, given: Any) -> Any:
    if isinstance(given, VectorType):
        return given, lambda x: x
    first = given[0] if len(given) else types.float64
    kind = next((each for each in given if isinstance(each, VectorType)), first)
    kind = types.float64 if isinstance(kind, types.Number) else kind
    return VectorType(len(given), kind), list


@on_vectors(np.roll, (VectorType, types.IntegerLiteral))
def _roll(context: Any, x: Any, shift: Any) -> Any:
    return x, lambda x, _: [x[(i - shift.literal_value) % len(x)] for i in range(len(x))]


@on_vectors(np.transpose, (VectorType,))
def _transposed(context: Any, x: Any) -> Any:
    if not isinstance(x.element, VectorType):
        return NONE
    to = VectorType(x.element.count, VectorType(x.count, x.element.element))
    return to, lambda x: zip(*x, strict=True)


@on_vectors(np.zeros_like, (VectorType,))
def _zeros(context: Any, x: Any) -> Any:
    return x, lambda x: None


@on_vectors(np.diag, (VectorType,))
def _diagonal(context: Any, x: Any) -> Any:
    places = range(x.count)
    return VectorType(x.count, x), lambda x: [
        [x[i] if i == k else None for k in places] for i in places
    ]


@on_vectors(operator.matmul, (VectorType, VectorType))
def _product(context: Any, a: Any, x: Any) -> Any:
    """Product of a matrix with a vector or a matrix, summed in order."""
    if not isinstance(a.element, VectorType) or a.element.count != x.count:
        return NONE
    row = elementwise(context, operator.mul, (a.element, x))
    return VectorType(a.count, row.element), lambda a, x: [
        _total(map(operator.mul, each, x)) for each in a
    ]


@on_vectors(np.sum, (VectorType,))
def _sum(context: Any, x: Any) -> Any:
    return x.element, _total


_total = functools.partial(functools.reduce, operator.add)  # in order
