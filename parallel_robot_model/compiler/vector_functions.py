"""Whole vectors in kernels: how they are made, read and reduced.

Registered with Numba are ``vector``, ``len``, indices, ``@``, ``np.sum``, ``np.roll``, ``np.diag``
and ``np.zeros_like``.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import type_callable

from parallel_robot_model.compiler.numba_parts import cgutils, lower_builtin
from parallel_robot_model.compiler.vectors import (
    VectorType,
    element_of,
    elementwise,
    emit,
    pack,
    vector,
)


@type_callable(len)
def _type_of_len(context: Any) -> Any:
    return lambda x: types.intp if isinstance(x, VectorType) else None


@lower_builtin(len, VectorType)
def _len(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    return context.get_constant(types.intp, signature.args[0].count)


@type_callable(operator.getitem)
def _type_of_item(context: Any) -> Any:
    def typer(x: Any, index: Any) -> Any:
        if not isinstance(x, VectorType):
            return None
        if isinstance(index, types.Integer):
            return x.element
        if isinstance(index, types.BaseTuple) and len(index) == 2:
            return element_of(x.element)
        return None

    return typer


@lower_builtin(operator.getitem, VectorType, types.Any)
def _item(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    kind, index = signature.args
    value, at = values
    if not isinstance(index, types.BaseTuple):
        return _at(context, builder, kind, value, index, at)
    row = _at(context, builder, kind, value, index.types[0], builder.extract_value(at, 0))
    return _at(context, builder, kind.element, row, index.types[1], builder.extract_value(at, 1))


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


@type_callable(np.roll)
def _type_of_roll(context: Any) -> Any:
    def typer(x: Any, shift: Any) -> Any:
        ours = isinstance(x, VectorType) and isinstance(shift, types.IntegerLiteral)
        return x if ours else None

    return typer


@lower_builtin(np.roll, VectorType, types.IntegerLiteral)
def _roll(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    kind, shift = signature.args
    places = [(i - shift.literal_value) % kind.count for i in range(kind.count)]
    elements = [builder.extract_value(values[0], place) for place in places]
    return pack(context, builder, kind, elements)


@type_callable(np.zeros_like)
def _type_of_zeros(context: Any) -> Any:
    return lambda x: x if isinstance(x, VectorType) else None


@lower_builtin(np.zeros_like, VectorType)
def _zeros(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    return ir.Constant(context.get_value_type(signature.return_type), None)


@type_callable(np.diag)
def _type_of_diagonal(context: Any) -> Any:
    return lambda x: VectorType(x.count, x) if isinstance(x, VectorType) else None


@lower_builtin(np.diag, VectorType)
def _diagonal(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    (kind,) = signature.args
    rows = []
    for i in range(kind.count):
        zero = ir.Constant(context.get_value_type(kind), None)
        element = builder.extract_value(values[0], i)
        rows.append(builder.insert_value(zero, element, i))
    return pack(context, builder, signature.return_type, rows)


@type_callable(operator.matmul)
def _type_of_product(context: Any) -> Any:
    def typer(a: Any, x: Any) -> Any:
        if not (isinstance(a, VectorType) and isinstance(a.element, VectorType)):
            return None
        if not (isinstance(x, VectorType) and a.element.count == x.count):
            return None
        row = elementwise(context, operator.mul, (a.element, x))
        return VectorType(a.count, row.element)

    return typer


@lower_builtin(operator.matmul, VectorType, VectorType)
def _product(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Product of a matrix and a vector, summed in order."""
    kind, x = signature.args
    sums = []
    for i in range(kind.count):
        row = builder.extract_value(values[0], i)
        of, terms = emit(context, builder, operator.mul, (kind.element, x), (row, values[1]))
        total = builder.extract_value(terms, 0)
        for j in range(1, of.count):
            term = builder.extract_value(terms, j)
            _, total = emit(context, builder, operator.add, (of.element,) * 2, (total, term))
        sums.append(total)
    return pack(context, builder, signature.return_type, sums)


@type_callable(vector)
def _type_of_vector(context: Any) -> Any:
    def typer(elements: Any) -> Any:
        if isinstance(elements, VectorType):
            return elements
        if not isinstance(elements, types.BaseTuple):
            return None
        if not len(elements):
            return VectorType(0, types.float64)
        return VectorType(len(elements), _real(elements.types[0]))

    return typer


def _real(kind: Any) -> Any:
    return types.float64 if isinstance(kind, types.Number) else kind


@lower_builtin(vector, types.BaseTuple)
def _vector(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    kind, (given,) = signature.return_type, signature.args
    elements = [
        context.cast(builder, builder.extract_value(values[0], i), each, kind.element)
        for i, each in enumerate(given.types)
    ]
    return pack(context, builder, kind, elements)


@lower_builtin(vector, VectorType)
def _itself(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    return values[0]


@type_callable(np.sum)
def _type_of_sum(context: Any) -> Any:
    return lambda x: x.element if isinstance(x, VectorType) else None


@lower_builtin(np.sum, VectorType)
def _sum(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Sum of the elements, in order."""
    (kind,) = signature.args
    total = builder.extract_value(values[0], 0)
    for i in range(1, kind.count):
        pair = (total, builder.extract_value(values[0], i))
        _, total = emit(context, builder, operator.add, (kind.element,) * 2, pair)
    return total
