"""Arithmetic of vectors and lanes in kernels, element by element, with the bits of scalars.

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
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.extending import type_callable

from parallel_robot_compiler.vector_types import LanesType, VectorType

_OURS = (VectorType, LanesType)
_INT32 = ir.IntType(32)

_ARITHMETIC = {
    operator.add: 'fadd', operator.sub: 'fsub', operator.mul: 'fmul', operator.truediv: 'fdiv',
}  # fmt: skip
_IN_PLACE = {  # a name is bound anew: a vector never changes
    operator.iadd: operator.add, operator.isub: operator.sub, operator.imul: operator.mul,
    operator.itruediv: operator.truediv,
}  # fmt: skip
_COMPARISONS = {
    operator.lt: '<', operator.le: '<=', operator.gt: '>', operator.ge: '>=',
    operator.eq: '==', operator.ne: '!=',
}  # fmt: skip
_LOGIC = {operator.and_: 'and_', operator.or_: 'or_'}
_OF_ANY = (operator.add, operator.sub, operator.mul, *_COMPARISONS, *_LOGIC)  # lanes of numbers
_INSTRUCTIONS = {
    math.sqrt: 'sqrt', np.sqrt: 'sqrt', abs: 'fabs', np.abs: 'fabs', math.floor: 'floor',
    np.floor: 'floor',
}  # fmt: skip
_BY_LANE = {  # no instruction: the function of the C library in each lane
    function: scalar
    for scalar, names in {
        math.sin: (math.sin, np.sin), math.cos: (math.cos, np.cos), math.tan: (math.tan, np.tan),
        math.tanh: (math.tanh, np.tanh), math.exp: (math.exp, np.exp),
        math.log: (math.log, np.log), math.atan: (math.atan, np.arctan),
        math.acos: (math.acos, np.arccos), math.asin: (math.asin, np.arcsin),
        math.atan2: (math.atan2, np.arctan2), operator.pow: (operator.pow,),
    }.items()
    for function in names
}  # fmt: skip
_COPYSIGN = (math.copysign, np.copysign)
UNARY = (operator.neg, np.sign, *_INSTRUCTIONS, *(
    f for f, scalar in _BY_LANE.items() if scalar not in (math.atan2, operator.pow)
))  # fmt: skip
BINARY = (*_ARITHMETIC, *_COMPARISONS, *_LOGIC, *_COPYSIGN, *(
    f for f, scalar in _BY_LANE.items() if scalar in (math.atan2, operator.pow)
))  # fmt: skip


def element_of(kind: Any) -> Any:
    """Type of an element of a vector; any other type itself."""
    return kind.element if isinstance(kind, VectorType) else kind


def elementwise(context: Any, function: Any, kinds: tuple[Any, ...]) -> Any:
    """Type of the result of a function of vectors, lanes and scalars; None if it has none."""
    vectors = [kind for kind in kinds if isinstance(kind, VectorType)]
    if vectors:
        if len({kind.count for kind in vectors}) > 1:
            return None
        inner = elementwise(context, function, tuple(map(element_of, kinds)))
        return None if inner is None else VectorType(vectors[0].count, inner)
    if not all(isinstance(kind, (LanesType, types.Number, types.Boolean)) for kind in kinds):
        return None
    lanes = [kind for kind in kinds if isinstance(kind, LanesType)]
    if not lanes:
        signature = _signature(context, function, kinds)
        return None if signature is None else signature.return_type
    if len(set(lanes)) > 1 or not _converts(kinds, lanes[0].scalar):
        return None
    if lanes[0].scalar != types.float64 and function not in _OF_ANY:
        return None
    scalar = lanes[0].scalar
    if function in _COMPARISONS:
        scalar = types.boolean
    return LanesType(lanes[0].count, scalar)


def _converts(kinds: tuple[Any, ...], scalar: Any) -> bool:
    """Whether scalars among lanes can become lanes without a loss."""
    allowed = {
        types.float64: types.Number, types.int64: types.Integer, types.boolean: types.Boolean
    }[scalar]  # fmt: skip
    return all(isinstance(kind, (LanesType, allowed)) for kind in kinds)


def _signature(context: Any, function: Any, kinds: tuple[Any, ...]) -> Any:
    return context.resolve_value_type(function).get_call_type(context, kinds, {})


def splat(context: Any, builder: Any, value: Any, kind: Any, to: LanesType) -> Any:
    """Emit a scalar as lanes; lanes themselves."""
    if isinstance(kind, LanesType):
        return value
    scalar = context.cast(builder, value, kind, to.scalar)
    space = ir.Constant(context.get_value_type(to), ir.Undefined)
    first = builder.insert_element(space, scalar, ir.Constant(_INT32, 0))
    mask = ir.Constant(ir.VectorType(_INT32, to.count), [0] * to.count)
    return builder.shuffle_vector(first, space, mask)


def emit(
    context: Any, builder: Any, function: Any, kinds: tuple[Any, ...], values: tuple[Any, ...]
) -> tuple[Any, Any]:
    """Emit a function of vectors, lanes and scalars; returns type and value of the result."""
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
    lanes = [kind for kind in kinds if isinstance(kind, LanesType)]
    if lanes:
        kind = elementwise(context.typing_context, function, kinds)
        if function in _BY_LANE:
            return kind, _lane_by_lane(context, builder, function, kinds, values, kind)
        wide = tuple(
            splat(context, builder, value, each, lanes[0])
            for each, value in zip(kinds, values, strict=True)
        )
        return kind, _in_lanes(context, builder, function, lanes[0], wide)
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


def _in_lanes(
    context: Any, builder: Any, function: Any, kind: LanesType, values: tuple[Any, ...]
) -> Any:
    is_float = kind.scalar == types.float64
    if function in _ARITHMETIC:
        name = _ARITHMETIC[function]
        return getattr(builder, name if is_float else name[1:])(*values)
    if function in _COMPARISONS:
        sign = _COMPARISONS[function]
        if not is_float:
            return builder.icmp_signed(sign, *values)
        compare = builder.fcmp_unordered if function is operator.ne else builder.fcmp_ordered
        return compare(sign, *values)
    if function in _LOGIC:
        return getattr(builder, _LOGIC[function])(*values)
    if function is operator.neg:
        return builder.fneg(*values)
    if function is np.sign:
        (x,) = values
        one = splat(context, builder, ir.Constant(ir.DoubleType(), 1.0), types.float64, kind)
        zero = ir.Constant(x.type, None)
        below = builder.select(builder.fcmp_ordered('<', x, zero), builder.fneg(one), x)
        return builder.select(builder.fcmp_ordered('>', x, zero), one, below)
    intrinsic = 'copysign' if function in _COPYSIGN else _INSTRUCTIONS.get(function)
    if intrinsic:
        shape = ir.FunctionType(values[0].type, [value.type for value in values])
        full = f'llvm.{intrinsic}.v{kind.count}f64'
        called = cgutils.get_or_insert_function(builder.module, shape, full)
        return builder.call(called, values)
    raise NotImplementedError(function)


def _lane_by_lane(
    context: Any, builder: Any, function: Any, kinds: Any, values: Any, to: LanesType
) -> Any:
    """Emit the function of the C library in each lane; `x ** 2` stays a product."""
    result = ir.Constant(context.get_value_type(to), ir.Undefined)
    each = tuple(kind.scalar if isinstance(kind, LanesType) else kind for kind in kinds)
    for i in range(to.count):
        place = ir.Constant(_INT32, i)
        parts = tuple(
            builder.extract_element(value, place) if isinstance(kind, LanesType) else value
            for kind, value in zip(kinds, values, strict=True)
        )
        _, one = emit(context, builder, _BY_LANE[function], each, parts)
        result = builder.insert_element(result, one, place)
    return result


def _register(name: Any, arity: int, function: Any = None) -> None:
    """Register a function under a name, its own or that of the operator in place."""
    function = function or name

    def typer_of_one(context: Any) -> Any:
        def typer(a: Any) -> Any:
            return elementwise(context, function, (a,)) if isinstance(a, _OURS) else None

        return typer

    def typer_of_two(context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            ours = isinstance(a, _OURS) or isinstance(b, _OURS)
            return elementwise(context, function, (a, b)) if ours else None

        return typer

    def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return emit(context, builder, function, signature.args, values)[1]

    type_callable(name)(typer_of_one if arity == 1 else typer_of_two)
    for kind in _OURS:
        if arity == 1:
            lower_builtin(name, kind)(lower)
        else:
            lower_builtin(name, kind, types.Any)(lower)
            lower_builtin(name, types.Any, kind)(lower)
            for other in _OURS:
                lower_builtin(name, kind, other)(lower)


for _each in UNARY:
    _register(_each, 1)
for _each in BINARY:
    _register(_each, 2)
for _each in _IN_PLACE:
    _register(_each, 2, _IN_PLACE[_each])
