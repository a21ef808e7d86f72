"""Arithmetic of vectors in kernels, element by element, with the bits of scalars.

Registered with Numba are Python's operators and the functions of ``math`` and ``numpy`` listed
here. A scalar counts for all elements.
"""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import type_callable

from parallel_robot_model.compiler.numba_parts import lower_builtin
from parallel_robot_model.compiler.vector_types import VectorType

_IN_PLACE: dict[Any, Any] = {  # a name is bound anew: a vector never changes
    operator.iadd: operator.add, operator.isub: operator.sub, operator.imul: operator.mul,
    operator.itruediv: operator.truediv,
}  # fmt: skip
UNARY: tuple[Any, ...] = (
    operator.neg, abs, np.abs, np.sign, math.floor, np.floor, math.sqrt, np.sqrt, math.sin, np.sin,
    math.cos, np.cos, math.tan, np.tan, math.tanh, np.tanh, math.exp, np.exp, math.log, np.log,
    math.atan, np.arctan, math.acos, np.arccos, math.asin, np.arcsin,
)  # fmt: skip
BINARY: tuple[Any, ...] = (
    operator.add, operator.sub, operator.mul, operator.truediv, operator.pow, operator.lt,
    operator.le, operator.gt, operator.ge, operator.eq, operator.ne, operator.and_, operator.or_,
    math.copysign, np.copysign, math.atan2, np.arctan2,
)  # fmt: skip


def element_of(kind: Any) -> Any:
    """Type of an element of a vector; any other type itself."""
    return kind.element if isinstance(kind, VectorType) else kind


def elementwise(context: Any, function: Any, kinds: tuple[Any, ...]) -> Any:
    """Type of the result of a function of vectors and scalars; None if it has none."""
    vectors = [kind for kind in kinds if isinstance(kind, VectorType)]
    if vectors:
        if len({kind.count for kind in vectors}) > 1:
            return None
        inner = elementwise(context, function, tuple(map(element_of, kinds)))
        return None if inner is None else VectorType(vectors[0].count, inner)
    if not all(isinstance(kind, (types.Number, types.Boolean)) for kind in kinds):
        return None
    signature = _signature(context, function, kinds)
    return None if signature is None else signature.return_type


def _signature(context: Any, function: Any, kinds: tuple[Any, ...]) -> Any:
    return context.resolve_value_type(function).get_call_type(context, kinds, {})


def emit(
    context: Any, builder: Any, function: Any, kinds: tuple[Any, ...], values: tuple[Any, ...]
) -> tuple[Any, Any]:
    """Emit a function of vectors and scalars; returns type and value of the result."""
    counts = [kind.count for kind in kinds if isinstance(kind, VectorType)]
    if counts:
        inner, elements = None, []
        for i in range(counts[0]):
            parts = tuple(
                builder.extract_value(value, i) if isinstance(kind, VectorType) else value
                for kind, value in zip(kinds, values, strict=True)
            )
            inner, element = emit(context, builder, function, tuple(map(element_of, kinds)), parts)
            elements.append(element)
        inner = inner or elementwise(context.typing_context, function, kinds).element
        kind = VectorType(counts[0], inner)
        return kind, pack(context, builder, kind, elements)
    signature = _signature(context.typing_context, function, kinds)
    call = context.get_function(context.typing_context.resolve_value_type(function), signature)
    given = [
        context.cast(builder, value, kind, to)
        for value, kind, to in zip(values, kinds, signature.args, strict=True)
    ]
    return signature.return_type, call(builder, given)


def pack(context: Any, builder: Any, kind: VectorType, elements: list[Any]) -> Any:
    """Emit a vector of elements."""
    result = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for i, element in enumerate(elements):
        result = builder.insert_value(result, element, i)
    return result


def _register(name: Any, arity: int, function: Any = None) -> None:
    """Register a function under a name, its own or that of the operator in place."""
    function = function or name

    def typer_of_one(context: Any) -> Any:
        def typer(a: Any) -> Any:
            return elementwise(context, function, (a,)) if isinstance(a, VectorType) else None

        return typer

    def typer_of_two(context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            ours = isinstance(a, VectorType) or isinstance(b, VectorType)
            return elementwise(context, function, (a, b)) if ours else None

        return typer

    def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return emit(context, builder, function, signature.args, values)[1]

    type_callable(name)(typer_of_one if arity == 1 else typer_of_two)
    if arity == 1:
        lower_builtin(name, VectorType)(lower)
        return
    for pair in ((VectorType, VectorType), (VectorType, types.Any), (types.Any, VectorType)):
        lower_builtin(name, *pair)(lower)


for _each in UNARY:
    _register(_each, 1)
for _each in BINARY:
    _register(_each, 2)
for _each in _IN_PLACE:
    _register(_each, 2, _IN_PLACE[_each])
