"""Constants that kernels take by their address.

A tuple of many numbers takes long to hand over: each of them is copied at every call. A boxed one
is written to memory once; kernels read its fields from there, by the same names.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.extending import NativeValue, models, register_model, unbox

from parallel_robot_model.compiler.kernels import kernel
from parallel_robot_model.compiler.numba_parts import (
    AttributeTemplate,
    FunctionModel,
    address_of,
    impl_ret_borrowed,
    in_kernels,
    infer_getattr,
    lower_getattr_generic,
)
from parallel_robot_model.compiler.vectors import INTERPRETED, Vector, divisible

# Values made of numbers, vectors and None: how they lie in memory, as kernels have them there.


def plain_type(value: Any) -> np.dtype[Any] | None:
    """How a value lies in memory; None if it is made of something else, too."""
    if isinstance(value, tuple):
        parts = [plain_type(part) for part in value]
        if any(part is None for part in parts):
            return None
        return np.dtype([(f'f{k}', part) for k, part in enumerate(parts)], align=True)
    if isinstance(value, Vector):
        return np.dtype((value.dtype, value.shape))
    if value is None:
        return np.dtype(np.intp)  # a pointer that nobody follows
    if isinstance(value, bool | int | float | complex | np.number | np.bool_):
        return np.asarray(value).dtype
    return None


def plain(value: Any) -> Any:
    """A value as it is written to memory."""
    if isinstance(value, tuple):
        return tuple(map(plain, value))
    return 0 if value is None else value


def read_plain(record: Any, like: Any) -> Any:
    """A value as it lies in memory, of the type of `like`."""
    if isinstance(like, tuple):
        parts = [read_plain(record[k], part) for k, part in enumerate(like)]
        return type(like)(*parts) if hasattr(like, '_fields') else tuple(parts)
    if isinstance(like, Vector):
        return np.array(record).view(Vector)
    return None if like is None else record.item()


# Kernels as values, for kernels that take a function.


class _FunctionType(types.FunctionType):  # type: ignore[misc]
    """Type of a function by address, told apart by the types of its arguments.

    Numba's own goes by the names of the types: two laws whose ``Gains`` have the same number of
    fields would be one type to it, and one law two types if its classes are named anew.
    """

    @property
    def key(self) -> Any:
        return self.signature


register_model(_FunctionType)(FunctionModel)


class FirstClass:
    """A kernel as a value: its machine code, by address, for kernels that take a function.

    A kernel that takes one is compiled once for the signature, not again for every function, and
    calls the very code that a direct call runs.
    """

    compiled: Any  # what Numba has made of it; not there where kernels are interpreted

    def __init__(self, function: Callable[..., Any], *example: Any) -> None:
        """Compile `function` for the types of the `example` arguments."""
        self.function = function  # the kernel
        if INTERPRETED:
            return
        dispatcher = cast(Any, function)
        arguments = tuple(numba.typeof(argument) for argument in example)
        dispatcher.compile(arguments)
        compiled = dispatcher.overloads[arguments]
        self.compiled = compiled
        self._signature = compiled.signature
        self._address = address_of(compiled)
        self._numba_type_ = _FunctionType(self._signature)  # saves a search at every call

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel from Python."""
        return self.function(*(divisible(arguments) if INTERPRETED else arguments))

    @property
    def fields(self) -> tuple[int, int, int]:
        """How it lies in memory, see FunctionModel."""
        return self._address, id(self), 0

    def erased(self, kind: Any) -> FirstClass:
        """The same with another type of its first argument, as wide as its own."""
        if INTERPRETED:
            return self
        other = copy.copy(self)
        known = self._signature
        other._signature = known.return_type(kind, *known.args[1:])
        other._numba_type_ = _FunctionType(other._signature)
        return other

    def __wrapper_address__(self) -> int:
        """Address of the machine code (Numba's protocol)."""
        return self._address

    def signature(self) -> Any:
        """Signature of the machine code (Numba's protocol)."""
        return self._signature


ALIGNMENT = 64  # bytes, of the widest register
LARGEST = 256  # bytes, of anything that is no array: a number, a text, a kernel, an array's header


class BoxedType(types.Type):  # type: ignore[misc]
    """Numba's type of a Boxed; `content` is the type of its tuple."""

    def __init__(self, content: Any) -> None:
        self.content = content
        super().__init__(f'Boxed({content})')

    @property
    def key(self) -> Any:
        """Its identity for Numba."""
        return self.content


ANY = BoxedType(types.none)  # of one whose tuple is not known


@register_model(BoxedType)
class _BoxedModel(models.OpaqueModel):  # type: ignore[misc]
    pass


class Boxed:
    """A tuple, and where it lies in memory; it must outlive the kernels that have it."""

    def __init__(self, value: Any, kind: Any = None) -> None:
        """Copy a tuple into memory; texts in it are kept while the process lives.

        Args:
            value: The tuple.
            kind: Its type for kernels: ANY; None: that of the tuple.
        """
        self.value = value  # the tuple
        if INTERPRETED:
            self.value, self._numba_type_ = divisible(value), ANY
            return
        self._numba_type_ = kind or BoxedType(typeof(value))
        written = _plain(value)
        layout = plain_type(written)
        room = _room(value) if layout is None else layout.itemsize
        self._memory = np.zeros(room + ALIGNMENT, np.uint8)
        begin = -self._memory.ctypes.data % ALIGNMENT
        self.address = self._memory.ctypes.data + begin  # address of its copy in memory
        if layout is None:
            _store(value, self.address)
        else:
            np.ndarray(1, layout, self._memory.data, begin)[0] = written

    def __getattr__(self, name: str) -> Any:
        """A field of the tuple."""
        if name.startswith('_'):
            raise AttributeError(name)
        return getattr(self.value, name)

    def __repr__(self) -> str:
        return repr(self.value)


def _plain(value: Any) -> Any:
    """A value with addresses in place of what lies elsewhere."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    if isinstance(value, FirstClass):
        return value.fields
    return value.address if isinstance(value, Boxed) else plain(value)


def _room(value: Any) -> int:
    """More memory than a value needs [bytes]; the exact size would have to be compiled for."""
    if isinstance(value, tuple):
        return sum(map(_room, value))
    size = LARGEST + getattr(value, 'nbytes', 0)
    return (size // ALIGNMENT + 1) * ALIGNMENT


def _write(value: Any, address: int) -> None:
    """Write a value to memory; Python has it in the object and does not."""


@in_kernels(_write)
def _write_in_kernels(context: Any, value: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = context.get_value_type(value).as_pointer()
        copy = _held(context, builder, value, values[0])
        builder.store(copy, builder.inttoptr(values[1], pointer))
        return context.get_dummy_value()

    return types.none(value, types.intp), generate


def _held(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Emit a copy of a value that owns its texts; its arrays live as long as the Boxed."""
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(kind.types):
            held = _held(context, builder, part, builder.extract_value(value, i))
            value = builder.insert_value(value, held, i)
        return value
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo, array.parent = (
            ir.Constant(pointer.type, None) for pointer in (array.meminfo, array.parent)
        )
        return array._getvalue()
    context.nrt.incref(builder, kind, value)
    return value


@kernel
def _store(value: Any, address: int) -> None:
    _write(value, address)


@unbox(BoxedType)
def _from_python(kind: Any, value: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(value, 'address')
    address = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(address)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = BoxedType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        fields = getattr(kind.content, 'fields', ())
        return kind.content[fields.index(name)] if name in fields else None


@lower_getattr_generic(BoxedType)
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    content = kind.content
    at = content.fields.index(name)
    start = builder.bitcast(value, context.get_value_type(content).as_pointer())
    place = [ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), at)]
    loaded = builder.load(builder.gep(start, place, inbounds=True))
    loaded.set_metadata('invariant.load', builder.module.add_metadata([]))  # may be read once
    return impl_ret_borrowed(context, builder, content[at], loaded)
