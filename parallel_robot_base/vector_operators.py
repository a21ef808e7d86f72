"""Arithmetic of vectors and lanes in kernels, element by element, with the bits of scalars.

Registered with Numba are Python's operators, the functions of ``math`` and ``numpy`` listed here,
and ``len``, indices, ``np.roll``, ``np.zeros_like`` and ``@``. A scalar counts for all elements.
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

from parallel_robot_base.vector_types import LanesType, VectorType, vector

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
    return lambda x: x if isinstance(x, _OURS) else None


@lower_builtin(np.zeros_like, VectorType)
@lower_builtin(np.zeros_like, LanesType)
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
        if not isinstance(elements, types.BaseTuple):
            return None
        if not len(elements):
            return VectorType(0, types.float64)
        lanes = [kind for kind in elements.types if isinstance(kind, LanesType)]
        return VectorType(len(elements), lanes[0] if lanes else _real(elements.types[0]))

    return typer


def _real(kind: Any) -> Any:
    return types.float64 if isinstance(kind, types.Number) else kind


@lower_builtin(vector, types.BaseTuple)
def _vector(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    kind, (given,) = signature.return_type, signature.args
    elements = []
    for i, each in enumerate(given.types):
        value = builder.extract_value(values[0], i)
        if isinstance(kind.element, LanesType):
            elements.append(splat(context, builder, value, each, kind.element))
        else:
            elements.append(context.cast(builder, value, each, kind.element))
    return pack(context, builder, kind, elements)


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
