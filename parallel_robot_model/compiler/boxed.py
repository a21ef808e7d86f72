"""Tuples that kernels take by their address: constants, and memory that they write.

A tuple of many numbers takes long to hand over: each of them is copied at every call. A boxed one
is written to memory once; kernels read its fields from there, by the same names. Those of a
Struct they and Python write, too.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numba
import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.extending import NativeValue, models, register_model, unbox

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler.kernels import kernel
from parallel_robot_model.compiler.numba_parts import (
    AttributeTemplate,
    FunctionModel,
    address_of,
    impl_ret_borrowed,
    in_kernels,
    infer_getattr,
    lower_getattr_generic,
    lower_setattr_generic,
)
from parallel_robot_model.compiler.vectors import INTERPRETED, Vector, divisible, vector
from parallel_robot_model.configuration.fields import PerJoint, parameters

Group = TypeVar('Group', bound=NamedTuple)

# Parameters as kernels read them.


def as_constants(group: Group) -> Group:
    """Parameters as kernels read them: numbers of the joints are vectors, words are numbers.

    A word is the number of its place among those that its parameter may be.
    """
    kinds = (parameter.type for parameter in parameters(type(group)))
    return type(group)(*map(_constant, kinds, group))


def _constant(kind: Any, value: Any) -> Any:
    if get_origin(kind) is Literal and isinstance(value, str):
        return get_args(kind).index(value)
    return vector(value) if kind is PerJoint or get_origin(kind) is tuple else value


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


def read_plain(record: Any, template: Any) -> Any:
    """A value in memory as one of the type of `template`, which keeps its references."""
    if isinstance(template, tuple):
        parts = [read_plain(record[k], part) for k, part in enumerate(template)]
        return type(template)(*parts) if hasattr(template, '_fields') else tuple(parts)
    if isinstance(template, Vector):
        return np.array(record).view(Vector)
    return template if template is None or _is_reference(template) else record.item()


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


class FunctionValue:
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

    def type_erased(self, kind: Any) -> FunctionValue:
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
        super().__init__(f'{type(self).__name__}({content})')

    @property
    def key(self) -> Any:
        """Its identity for Numba."""
        return self.content


ALL_FIELDS = 'value'  # what kernels call all fields of a Struct


class StructType(BoxedType):
    """Numba's type of a Struct."""


OPAQUE = BoxedType(types.none)  # of one whose tuple is not known


@register_model(BoxedType)
@register_model(StructType)
class _BoxedModel(models.OpaqueModel):  # type: ignore[misc]
    pass


class Boxed:
    """A tuple, and where it lies in memory; it must outlive the kernels that have it."""

    _type: Any = BoxedType

    def __init__(self, value: Any, kind: Any = None) -> None:
        """Copy a tuple into memory; texts in it are kept while the process lives.

        Args:
            value: The tuple.
            kind: Its type for kernels: ANY; None: that of the tuple.
        """
        if INTERPRETED:
            self._value, self._numba_type_ = divisible(value), OPAQUE
            return
        self._value = value
        self._numba_type_ = kind or self._type(typeof(value))
        written = _plain(value)
        layout = plain_type(written)
        room = _room(value) if layout is None else layout.itemsize
        memory = np.zeros(room + ALIGNMENT, np.uint8)
        begin = -memory.ctypes.data % ALIGNMENT
        self.address: int = memory.ctypes.data + begin  # of its copy in memory
        self._record: Any = memory  # that copy, an array of one if its layout is plain
        if layout is None:
            _store(value, self.address)
        else:
            self._record = np.ndarray(1, layout, memory.data, begin)
            self._record[0] = written

    @property
    def value(self) -> Any:
        """The tuple."""
        return self._value

    def __getattr__(self, name: str) -> Any:
        """A field of the tuple."""
        if name.startswith('_'):
            raise AttributeError(name)
        return getattr(self.value, name)

    def __repr__(self) -> str:
        return repr(self.value)


class Struct(Boxed):
    """A tuple in memory whose fields kernels and Python write, by their names.

    A field is a number, a vector, a tuple of such, an array, or something boxed; those of the last
    two kinds stay what they are, and it is their elements and fields that change. All fields
    together are its `value`, in kernels, too.
    """

    _type = StructType

    def __init__(self, value: Any) -> None:
        """Copy a tuple into memory; what lies elsewhere stays where it is."""
        self._views: dict[str, Any] = {}  # of the fields that lie here
        super().__init__(value)
        if INTERPRETED:
            return
        for k, (name, each) in enumerate(zip(value._fields, value, strict=True)):
            if _is_reference(each):
                self.__dict__[name] = each
            else:
                self._views[name] = self._record[f'f{k}']

    @property
    def value(self) -> Any:
        """What lies in memory now, with the same arrays and boxes."""
        return self._value if INTERPRETED else read_plain(self._record[0], self._value)

    @value.setter
    def value(self, new: Any) -> None:
        for name, before, each in zip(self._value._fields, self._value, new, strict=True):
            if not _is_reference(before):
                setattr(self, name, each)

    def __getattr__(self, name: str) -> Any:
        """A field."""
        if name.startswith('_') or name not in self._views:
            return super().__getattr__(name)
        return read_plain(self._views[name][0], getattr(self._value, name))

    def __setattr__(self, name: str, new: Any) -> None:
        """Write a field."""
        if name.startswith('_') or name not in self._value._fields:
            object.__setattr__(self, name, new)
        elif INTERPRETED:
            self.__dict__['_value'] = self._value._replace(**{name: divisible(new)})
        else:
            self._views[name][0] = plain(new)

    def copy(self) -> list[Any]:
        """All of it, for :meth:`restore`."""
        return [
            each.copy() if isinstance(each, np.ndarray | Struct) else each for each in self.value
        ]

    def restore(self, copy: list[Any]) -> None:
        """Be as when a copy was made, of this or of one with the same types and sizes."""
        for name, each, saved in zip(self.value._fields, self.value, copy, strict=True):
            if isinstance(each, Struct):
                each.restore(saved)
            elif not _is_reference(each):
                setattr(self, name, saved)
            elif isinstance(each, np.ndarray):
                each[:] = saved


_hints = functools.cache(get_type_hints)


def zeros_of(kind: Any, zero: Array) -> Any:
    """A named tuple of zeros, by the types of its fields; `zero`: that of each vector."""
    if kind in (bool, int, float):
        return kind()
    if not hasattr(kind, '_fields'):
        return zero
    return kind(*(zeros_of(each, zero) for each in _hints(kind).values()))


def _is_reference(value: Any) -> bool:
    """Whether a Struct has but the address of a value."""
    is_array = isinstance(value, np.ndarray) and not isinstance(value, Vector)
    return is_array or isinstance(value, Boxed | FunctionValue)


def _plain(value: Any) -> Any:
    """A value with addresses in place of what lies elsewhere."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    if isinstance(value, FunctionValue):
        return value.fields
    if isinstance(value, np.ndarray) and not isinstance(value, Vector):
        # no owner and no parent: it lives as long as the Boxed
        return 0, 0, value.size, value.itemsize, value.ctypes.data, value.shape, value.strides
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
        copy = _owned(context, builder, value, values[0])
        builder.store(copy, builder.inttoptr(values[1], pointer))
        return context.get_dummy_value()

    return types.none(value, types.intp), generate


def _owned(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Emit a copy of a value that owns its texts; its arrays live as long as the Boxed."""
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(kind.types):
            held = _owned(context, builder, part, builder.extract_value(value, i))
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
@unbox(StructType)
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
        if name in fields:
            return kind.content[fields.index(name)]
        return kind.content if name == ALL_FIELDS and isinstance(kind, StructType) else None


@lower_getattr_generic(BoxedType)
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    inner, place = _field_pointer(context, builder, kind, value, name)
    loaded = builder.load(place)
    if not isinstance(kind, StructType):  # may be read once
        loaded.set_metadata('invariant.load', builder.module.add_metadata([]))
    return impl_ret_borrowed(context, builder, inner, loaded)


@lower_setattr_generic(StructType)
def _set_field(context: Any, builder: Any, signature: Any, values: Any, name: str) -> None:
    kind, source = signature.args
    inner, place = _field_pointer(context, builder, kind, values[0], name)
    builder.store(context.cast(builder, values[1], source, inner), place)


def _field_pointer(
    context: Any, builder: Any, kind: Any, value: Any, name: str
) -> tuple[Any, Any]:
    """Type of a field, and emit a pointer to it."""
    content = kind.content
    start = builder.bitcast(value, context.get_value_type(content).as_pointer())
    if name not in content.fields:
        return content, start
    at = content.fields.index(name)
    place = [ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), at)]
    return content[at], builder.gep(start, place, inbounds=True)
