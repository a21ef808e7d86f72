"""Vectors in kernels: their type, how they come from Python, and their arithmetic."""

from __future__ import annotations

import functools
import math
import operator
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import (
    NativeValue,
    box,
    models,
    register_model,
    type_callable,
    typeof_impl,
    unbox,
)

from parallel_robot_model.compiler.numba_parts import cgutils, lower_builtin

# Numba's type of vectors: how they are stored, and how they come from Python.
#
# A vector has a fixed number of elements; its size is a part of its type. A kernel takes and
# returns it as a value, as it does a float: nothing is allocated, nothing is shared. A vector of
# vectors is a matrix.

INTERPRETED = bool(numba.config.DISABLE_JIT)  # kernels run as plain Python, for a debugger
if INTERPRETED:
    np.seterr(all='ignore')  # 1 / 0 is inf, and whole numbers wrap around, as in kernels


class Vector(np.ndarray):
    """A vector, shape (n,), or a matrix, shape (n, n), that kernels take as a value."""

    if INTERPRETED:  # it computes as in kernels

        def __array_ufunc__(
            self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **named: Any
        ) -> Any:
            """A new vector, also where a name is bound anew (``+=``)."""
            plain = tuple(
                each.view(np.ndarray) if isinstance(each, Vector) else each for each in inputs
            )
            if ufunc is np.matmul:  # summed in order
                result = functools.reduce(np.add, map(np.multiply.outer, plain[0].T, plain[1]))
            else:
                plain = aligned(plain) if method == '__call__' else plain
                result = getattr(ufunc, method)(*plain, **named)
            return result.view(Vector) if isinstance(result, np.ndarray) else result

        def __getitem__(self, index: Any) -> Any:
            """An element; the index counts modulo the size."""
            whole = (int, np.integer)
            if isinstance(index, whole):
                index %= len(self)
            elif isinstance(index, tuple) and all(isinstance(each, whole) for each in index):
                index = tuple(i % n for i, n in zip(index, self.shape, strict=True))
            return super().__getitem__(index)


def divisible(value: Any) -> Any:
    """A value, or a tuple of them, with floats that Python can divide by zero, as kernels do."""
    if isinstance(value, tuple):
        parts = map(divisible, value)
        return type(value)(*parts) if hasattr(value, '_fields') else tuple(parts)
    return np.float64(value) if type(value) is float else value


def aligned(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Numbers and arrays such that their first axes go together: an element counts for a row."""
    most = max(map(np.ndim, values))
    return tuple(
        each.reshape(each.shape + (1,) * (most - each.ndim)) if np.ndim(each) else each
        for each in values
    )


class VectorType(types.Type):  # type: ignore[misc]
    """Numba's type of a vector."""

    def __init__(self, count: int, element: Any) -> None:
        # count: number of its elements; element: type of an element: a scalar or a vector
        self.count, self.element = count, element
        super().__init__(f'Vector({count}, {element})')

    @property
    def key(self) -> Any:
        """Its identity for Numba: size and element."""
        return self.count, self.element


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: VectorType) -> None:
        element = manager.lookup(kind.element).get_value_type()
        super().__init__(manager, kind, ir.ArrayType(element, kind.count))


_SCALARS = {
    np.dtype(np.float64): types.float64,
    np.dtype(np.int64): types.int64,
    np.dtype(np.bool_): types.boolean,
}


@typeof_impl.register(Vector)
def _type_of_vector(value: Vector, context: Any) -> Any:
    return _vector_type(value.dtype, value.shape)


@functools.cache
def _vector_type(dtype: np.dtype[Any], shape: tuple[int, ...]) -> Any:
    kind: Any = _SCALARS.get(dtype)  # None: Numba does not know the type
    for count in reversed(shape):
        kind = kind and VectorType(count, kind)
    return kind


@typeof_impl.register(tuple)
def _type_of_tuple(value: tuple[Any, ...], context: Any) -> Any:
    """Type of a tuple, as Numba makes it, but found again by its class and elements.

    Numba makes a new one at every call, whose hash is that of the whole tree of its types.
    """
    kinds = [typeof_impl(each, context) for each in value]
    if any(kind is None for kind in kinds):
        return None
    key = (type(value), *map(id, kinds))  # the type that is found keeps those of its elements
    kind = _TUPLES.get(key)
    if kind is None:
        kind = _TUPLES[key] = types.BaseTuple.from_types(kinds, type(value))
    return kind


_TUPLES: dict[tuple[Any, ...], Any] = {}


def holds_vectors(value: Any) -> bool:
    """Whether a value is a vector, or a tuple with one anywhere in it."""
    if isinstance(value, tuple):
        return any(map(holds_vectors, value))
    return isinstance(value, Vector)


def shape_of(kind: Any) -> tuple[tuple[int, ...], Any]:
    """Shape of a value of a type as an array; its scalar."""
    if isinstance(kind, VectorType):
        rest, scalar = shape_of(kind.element)
        return (kind.count, *rest), scalar
    return (), kind


@unbox(VectorType)
def _from_python(kind: Any, value: Any, c: Any) -> Any:
    shape, scalar = shape_of(kind)
    array_type = types.Array(scalar, len(shape), 'C')
    native = c.unbox(array_type, value)
    result = cgutils.alloca_once(c.builder, c.context.get_value_type(kind))
    failed = cgutils.alloca_once_value(c.builder, native.is_error)
    with c.builder.if_then(c.builder.not_(native.is_error), likely=True):
        array = c.context.make_array(array_type)(c.context, c.builder, native.value)
        with c.builder.if_else(_fits(c, array, shape), likely=True) as (fits, differs):
            with fits:
                c.builder.store(load(c.context, c.builder, kind, array.data), result)
            with differs:
                text = f'expected a contiguous array of shape {shape}'
                c.pyapi.err_set_string('PyExc_TypeError', text)
                c.builder.store(cgutils.true_bit, failed)
        c.context.nrt.decref(c.builder, array_type, native.value)
    return NativeValue(c.builder.load(result), is_error=c.builder.load(failed))


def _fits(c: Any, array: Any, shape: tuple[int, ...]) -> Any:
    """Emit whether an array has a shape and its elements are consecutive."""
    lengths = cgutils.unpack_tuple(c.builder, array.shape, len(shape))
    strides = cgutils.unpack_tuple(c.builder, array.strides, len(shape))
    result, step = cgutils.true_bit, array.itemsize
    for count, length, stride in reversed(list(zip(shape, lengths, strides, strict=True))):
        size = c.context.get_constant(types.intp, count)
        result = c.builder.and_(result, c.builder.icmp_signed('==', length, size))
        if count > 1 and 0 not in shape:
            result = c.builder.and_(result, c.builder.icmp_signed('==', stride, step))
        step = c.builder.mul(step, size)
    return result


@box(VectorType)
def _to_python(kind: Any, value: Any, c: Any) -> Any:
    shape, scalar = shape_of(kind)
    size = math.prod(shape) * (1 if scalar == types.boolean else 8)
    space = cgutils.alloca_once(c.builder, ir.IntType(8), size=max(1, size))
    store(c.context, c.builder, kind, value, space)
    data = c.pyapi.bytes_from_string_and_size(space, c.context.get_constant(types.intp, size))
    how = (shape, {types.float64: 'f8', types.int64: 'i8'}.get(scalar, '?'))
    make = c.pyapi.unserialize(c.pyapi.serialize_object(_array))
    words = c.pyapi.unserialize(c.pyapi.serialize_object(how))
    result = c.pyapi.call_function_objargs(make, (data, words))
    for each in (data, make, words):
        c.pyapi.decref(each)
    return result


def _array(data: bytes, how: tuple[tuple[int, ...], str]) -> Any:
    shape, dtype = how
    return np.frombuffer(data, dtype).reshape(shape).copy().view(Vector)


def load(context: Any, builder: Any, kind: Any, pointer: Any) -> Any:
    """Emit the reading of a value of a type from the consecutive elements of an array."""
    _, scalar = shape_of(kind)
    if scalar == types.boolean:
        return _bytes_to_bits(context, builder, kind, pointer)
    to = context.get_value_type(kind).as_pointer()
    return builder.load(builder.bitcast(pointer, to), align=1)


def store(context: Any, builder: Any, kind: Any, value: Any, pointer: Any) -> None:
    """Emit the writing of a value of a type to the consecutive elements of an array."""
    _, scalar = shape_of(kind)
    if scalar == types.boolean:
        byte = ir.IntType(8)
        target = builder.bitcast(pointer, byte.as_pointer())
        for at, bit in enumerate(_scalars(builder, kind, value)):
            slot = builder.gep(target, [ir.Constant(ir.IntType(64), at)])
            builder.store(builder.zext(bit, byte) if bit.type.width < 8 else bit, slot)
        return
    to = context.get_value_type(kind).as_pointer()
    builder.store(value, builder.bitcast(pointer, to), align=1)


def _scalars(builder: Any, kind: Any, value: Any) -> list[Any]:
    if isinstance(kind, VectorType):
        parts = [builder.extract_value(value, i) for i in range(kind.count)]
        return [each for part in parts for each in _scalars(builder, kind.element, part)]
    return [value]


def _bytes_to_bits(context: Any, builder: Any, kind: Any, pointer: Any) -> Any:
    source = builder.bitcast(pointer, ir.IntType(8).as_pointer())
    counter = iter(range(1 << 30))

    def read(part: Any) -> Any:
        result = ir.Constant(context.get_value_type(part), ir.Undefined)
        if isinstance(part, VectorType):
            for i in range(part.count):
                result = builder.insert_value(result, read(part.element), i)
            return result
        slot = builder.gep(source, [ir.Constant(ir.IntType(64), next(counter))])
        return builder.trunc(builder.load(slot), ir.IntType(1))

    return read(kind)


def vector(values: Any) -> Any:
    """A vector or matrix of numbers; also in kernels, from a tuple of scalars or of vectors."""
    return np.array(values, dtype=np.float64, order='C').view(Vector)


def as_vectors(values: Any) -> Any:
    """Tuples of numbers and arrays with vectors in place of the arrays."""
    if isinstance(values, tuple):
        parts = map(as_vectors, values)
        return type(values)(*parts) if hasattr(values, '_fields') else tuple(parts)
    if type(values) is np.ndarray and values.dtype in _SCALARS:
        return np.array(values, order='C').view(Vector)
    return values


def as_arrays(values: Any) -> Any:
    """Tuples of numbers and vectors with arrays in place of the vectors."""
    if isinstance(values, tuple):
        parts = map(as_arrays, values)
        return type(values)(*parts) if hasattr(values, '_fields') else tuple(parts)
    return np.array(values) if type(values) is Vector else values


def tuple_like(kind: Any, kinds: list[Any]) -> Any:
    """Type of a tuple of the same class with other elements."""
    return types.BaseTuple.from_types(kinds, getattr(kind, 'instance_class', None))


# Arithmetic of vectors in kernels, element by element, with the bits of scalars.
#
# Registered with Numba are Python's operators and the functions of ``math`` and ``numpy`` listed
# here. A scalar counts for all elements.

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
    math.copysign, np.copysign, math.atan2, np.arctan2, np.maximum, np.minimum,
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
