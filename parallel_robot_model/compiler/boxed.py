"""Constants that kernels take by their address.

A tuple of many numbers takes long to hand over: each of them is copied at every call. A boxed one
is written to memory once; kernels read its fields from there, by the same names.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.extending import NativeValue, models, register_model, unbox

from parallel_robot_model.compiler.function_value import FirstClass
from parallel_robot_model.compiler.kernels import kernel
from parallel_robot_model.compiler.numba_parts import (
    AttributeTemplate,
    impl_ret_borrowed,
    in_kernels,
    infer_getattr,
    lower_getattr_generic,
)
from parallel_robot_model.compiler.plain_values import plain, plain_type
from parallel_robot_model.compiler.vectors import INTERPRETED, divisible

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
    """A tuple, and where it lies in memory; it must outlive the kernels that have it.

    Attributes:
        value: The tuple.
        address: Address of its copy in memory.
    """

    def __init__(self, value: Any, kind: Any = None) -> None:
        """Copy a tuple into memory; texts in it are kept while the process lives.

        Args:
            value: The tuple.
            kind: Its type for kernels: ANY; None: that of the tuple.
        """
        self.value = value
        if INTERPRETED:
            self.value, self._numba_type_ = divisible(value), ANY
            return
        self._numba_type_ = kind or BoxedType(typeof(value))
        written = _plain(value)
        layout = plain_type(written)
        room = _room(value) if layout is None else layout.itemsize
        self._memory = np.zeros(room + ALIGNMENT, np.uint8)
        begin = -self._memory.ctypes.data % ALIGNMENT
        self.address = self._memory.ctypes.data + begin
        if layout is None:
            _store(value, self.address)
        else:
            np.ndarray(1, layout, self._memory.data, begin)[0] = written

    def __getattr__(self, name: str) -> Any:
        """A field of the tuple."""
        if name.startswith('_'):
            raise AttributeError(name)
        return getattr(self.value, name)


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
