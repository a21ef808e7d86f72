"""Vectors in kernels: their type, how they come from Python, and their arithmetic."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterator
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
    typeof_impl,
    unbox,
)

from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels

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


def through(function: Any, *values: Any) -> Any:
    """A tuple of the class of the first one, of what a function makes of the elements."""
    parts = map(function, *values)
    return type(values[0])(*parts) if hasattr(values[0], '_fields') else tuple(parts)


def divisible(value: Any) -> Any:
    """A value, or a tuple of them, with floats that Python can divide by zero, as kernels do."""
    if isinstance(value, tuple):
        return through(divisible, value)
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
    shape, scalar = shape_of(kind)
    if scalar == types.boolean:
        source = builder.bitcast(pointer, ir.IntType(8).as_pointer())
        places = np.arange(math.prod(shape)).reshape(shape).tolist()
        return packed(context, builder, kind, _bits(context, builder, source, places))
    to = context.get_value_type(kind).as_pointer()
    return builder.load(builder.bitcast(pointer, to), align=1)


def _bits(context: Any, builder: Any, source: Any, places: Any) -> Any:
    """Emit truth values, of one byte each, at places."""
    if isinstance(places, list):
        return [_bits(context, builder, source, each) for each in places]
    byte = builder.load(builder.gep(source, [ir.Constant(ir.IntType(64), places)]))
    return Emitted(context, builder, types.boolean, builder.trunc(byte, ir.IntType(1)))


def store(context: Any, builder: Any, kind: Any, value: Any, pointer: Any) -> None:
    """Emit the writing of a value of a type to the consecutive elements of an array."""
    shape, scalar = shape_of(kind)
    if scalar == types.boolean:
        byte = ir.IntType(8)
        target = builder.bitcast(pointer, byte.as_pointer())
        for at, place in enumerate(np.ndindex(shape)):
            slot = builder.gep(target, [ir.Constant(ir.IntType(64), at)])
            bit = builder.extract_value(value, place) if shape else value
            builder.store(builder.zext(bit, byte) if bit.type.width < 8 else bit, slot)
        return
    to = context.get_value_type(kind).as_pointer()
    builder.store(value, builder.bitcast(pointer, to), align=1)


def vector(values: Any) -> Any:
    """A vector or matrix of numbers; also in kernels, from a tuple of scalars or of vectors."""
    return np.array(values, dtype=np.float64, order='C').view(Vector)


def as_vectors(values: Any) -> Any:
    """Tuples of numbers and arrays with vectors in place of the arrays."""
    if isinstance(values, tuple):
        return through(as_vectors, values)
    if type(values) is np.ndarray and values.dtype in _SCALARS:
        return np.array(values, order='C').view(Vector)
    return values


def as_arrays(values: Any) -> Any:
    """Tuples of numbers and vectors with arrays in place of the vectors."""
    if isinstance(values, tuple):
        return through(as_arrays, values)
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


class Emitted:
    """A value in a kernel whose code is being emitted: what is computed with it is emitted."""

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        # kind: type of a number, a vector or a tuple; value: what LLVM has of it
        self.place, self.kind, self.value = (context, builder), kind, value

    def __len__(self) -> int:
        """Number of the elements of a vector or a tuple."""
        return self.kind.count if isinstance(self.kind, VectorType) else len(self.kind)

    def __iter__(self) -> Iterator[Emitted]:
        """Its elements."""
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, index: Any) -> Emitted:
        """An element; that of a matrix by row and column."""
        if isinstance(index, tuple):
            return self[index[0]][index[1]]
        kind = self.kind.element if isinstance(self.kind, VectorType) else self.kind.types[index]
        return Emitted(*self.place, kind, self.place[1].extract_value(self.value, index))

    def __add__(self, other: Emitted) -> Emitted:
        """Sum."""
        return emit(operator.add, self, other)

    def __sub__(self, other: Emitted) -> Emitted:
        """Difference."""
        return emit(operator.sub, self, other)

    def __mul__(self, other: Emitted) -> Emitted:
        """Product."""
        return emit(operator.mul, self, other)

    def __truediv__(self, other: Emitted) -> Emitted:
        """Quotient."""
        return emit(operator.truediv, self, other)


def rows_of(*values: Emitted) -> Any:
    """The elements of vectors that go together; a scalar counts for all."""
    count = next(len(each) for each in values if isinstance(each.kind, VectorType))
    return zip(
        *([x] * count if not isinstance(x.kind, VectorType) else x for x in values), strict=True
    )


def emit(function: Any, *values: Emitted) -> Emitted:
    """Emit a function of vectors and scalars."""
    context, builder = values[0].place
    kinds = tuple(each.kind for each in values)
    if any(isinstance(kind, VectorType) for kind in kinds):
        to = elementwise(context.typing_context, function, kinds)
        elements = [emit(function, *row) for row in rows_of(*values)]
        return Emitted(context, builder, to, packed(context, builder, to, elements))
    signature = _signature(context.typing_context, function, kinds)
    call = context.get_function(context.typing_context.resolve_value_type(function), signature)
    given = [packed(context, builder, *pair) for pair in zip(signature.args, values, strict=True)]
    return Emitted(context, builder, signature.return_type, call(builder, given))


def packed(context: Any, builder: Any, to: Any, result: Any) -> Any:
    """Emit a value of a type: of one that is emitted, of its elements, or zeros for None."""
    if result is None:
        return ir.Constant(context.get_value_type(to), None)
    if isinstance(result, Emitted):
        if isinstance(to, VectorType) and isinstance(result.kind, types.Number):
            result = [result] * to.count  # a number counts for all elements
        else:
            return context.cast(builder, result.value, result.kind, to)
    kinds = to.types if isinstance(to, types.BaseTuple) else [to.element] * to.count
    parts = [packed(context, builder, *pair) for pair in zip(kinds, result, strict=True)]
    if isinstance(to, types.BaseTuple):
        return context.make_tuple(builder, to, parts)
    whole = ir.Constant(context.get_value_type(to), ir.Undefined)
    for i, part in enumerate(parts):
        whole = builder.insert_value(whole, part, i)
    return whole


def on_vectors(function: Any, *patterns: tuple[Any, ...]) -> Callable[[Any], Any]:
    """Define a function of vectors by what is computed with their elements.

    Args:
        function: The function that kernels call.
        patterns: Classes of the types of its arguments; none: all types.

    Returns:
        A decorator. What it takes gets the typing context and the types of the arguments; it
        returns the type of the result, None if there is none, and a function of Emitted that makes
        it: one, a list of elements, or None for zeros.
    """

    def register(define: Any) -> Any:
        @in_kernels(function, *patterns)
        def _defined(context: Any, *kinds: Any) -> Any:
            to, compute = define(context, *kinds)

            def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                parts = zip(signature.args, values, strict=True)
                given = [Emitted(context, builder, kind, value) for kind, value in parts]
                return packed(context, builder, to, compute(*given))

            return None if to is None else (to(*kinds), generate)

        return define

    return register


def _register(name: Any, arity: int, function: Any = None) -> None:
    """Register a function under a name, its own or that of the operator in place."""
    function = function or name
    two = (VectorType, VectorType), (VectorType, types.Any), (types.Any, VectorType)

    @on_vectors(name, *(((VectorType,),) if arity == 1 else two))
    def _defined(context: Any, *kinds: Any) -> Any:
        return elementwise(context, function, kinds), functools.partial(emit, function)


for _each in UNARY:
    _register(_each, 1)
for _each in BINARY:
    _register(_each, 2)
for _each in _IN_PLACE:
    _register(_each, 2, _IN_PLACE[_each])
