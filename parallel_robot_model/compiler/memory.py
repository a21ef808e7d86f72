"""Memory that kernels read and write by its address."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.boxed import plain, plain_type, read_plain
from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels
from parallel_robot_model.compiler.vectors import Vector, load, shape_of, store

# A value that kernels keep by its address, whatever its type: who keeps it need not know that.
#
# Its memory has room for three values, one after the other: two of which one is present and the
# next one is written to the other, so that it can be dropped, and the first one.

ALIGNMENT = 64  # bytes, of the widest register
HEAD = 64  # bytes, before the values: the number of the present one
FIRST = 2  # number of the first value

_WORD = ir.IntType(64)


class KeptValue(int):
    """Address of a value that has a plain_type, which lives as long as this."""

    first: Any  # the value that it begins with
    _bytes: Any
    _number: Any
    _values: list[Any]

    def __new__(cls, first: Any) -> KeptValue:
        """Keep a value; it is present.

        Raises:
            TypeError: it has no plain_type.
        """
        kind = plain_type((first,))
        if kind is None:
            raise TypeError(f'made of numbers, vectors and None, not {first!r}')
        step = -(-kind.itemsize // ALIGNMENT) * ALIGNMENT
        room = np.zeros(HEAD + 3 * step + ALIGNMENT, np.uint8)
        start = -room.ctypes.data % ALIGNMENT
        made = super().__new__(cls, room.ctypes.data + start)
        made.first, made._bytes = first, room[start : start + HEAD + 3 * step]
        made._number = made._bytes[:8].view(np.int64)
        made._values = [np.ndarray(1, kind, made._bytes.data, HEAD + k * step) for k in range(3)]
        made._values[FIRST][0] = (plain(first),)
        made.begin()
        return made

    @property
    def value(self) -> Any:
        """The present value."""
        return read_plain(self._values[self._number[0]][0][0], self.first)

    def begin(self) -> None:
        """Let the first value be present."""
        self._number[0] = FIRST

    def propose(self, value: Any) -> None:
        """Write the next value."""
        self._values[1 if self._number[0] == 0 else 0][0] = (plain(value),)

    @property
    def size(self) -> int:
        """All of it [bytes]."""
        return int(self._bytes.nbytes)

    def copy(self) -> Any:
        """All of it, for :meth:`restore`, shape (bytes,)."""
        return self._bytes.copy()

    @property
    def begun(self) -> Any:
        """The same with the first value present."""
        first = self.copy()
        first[:8].view(np.int64)[0] = FIRST
        return first

    def restore(self, copy: Any) -> None:
        """Be as when a copy was made, of this or of one of the same type."""
        self._bytes[:] = copy


def present(kept: Any, like: Any) -> Any:
    """The present value, of the type of `like`; nothing is checked."""
    return kept.value


def propose(kept: Any, value: Any, like: Any) -> None:
    """Write the next value, of the type of `like`; it is present after :func:`keep`."""
    kept.propose(value)


def keep(kept: Any) -> None:
    """Let the next value be present."""
    kept._number[0] = 1 if kept._number[0] == 0 else 0


def begin(kept: Any) -> None:
    """Let the first value be present."""
    kept.begin()


def _number(builder: Any, address: Any) -> Any:
    """Emit a pointer to the number of the present value."""
    return builder.inttoptr(address, _WORD.as_pointer())


def _other(builder: Any, number: Any) -> Any:
    """Emit the number of the next value."""
    return builder.zext(builder.icmp_signed('==', number, _WORD(0)), _WORD)


def _kept_place(context: Any, builder: Any, kind: Any, address: Any, number: Any) -> Any:
    """Emit a pointer to a value of a type."""
    data = context.get_value_type(kind)
    step = -(-context.get_abi_sizeof(data) // ALIGNMENT) * ALIGNMENT
    start = builder.add(address, builder.add(_WORD(HEAD), builder.mul(number, _WORD(step))))
    return builder.inttoptr(start, data.as_pointer())


@in_kernels(present)
def _present(context: Any, kept: Any, like: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = builder.load(_number(builder, values[0]))
        return builder.load(_kept_place(context, builder, like, values[0], number))

    return like(types.intp, like), generate


@in_kernels(propose)
def _propose(context: Any, kept: Any, value: Any, like: Any) -> Any:
    if value != like:
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = _other(builder, builder.load(_number(builder, values[0])))
        builder.store(values[1], _kept_place(context, builder, value, values[0], number))
        return context.get_dummy_value()

    return types.none(types.intp, value, like), generate


@in_kernels(keep)
def _keep(context: Any, kept: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        at = _number(builder, values[0])
        builder.store(_other(builder, builder.load(at)), at)
        return context.get_dummy_value()

    return types.none(types.intp), generate


@in_kernels(begin)
def _begin(context: Any, kept: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store(_WORD(FIRST), _number(builder, values[0]))
        return context.get_dummy_value()

    return types.none(types.intp), generate


# Memory that kernels reach by its address, which a boxed tuple can hold; arrays it cannot.

_DOUBLE = ir.DoubleType().as_pointer()


class Space(int):
    """Address of floats, which live as long as it does."""

    floats: np.ndarray

    def __new__(cls, count: int) -> Space:
        """Make room for `count` floats, all zero."""
        return cls.within(np.zeros(count))

    @classmethod
    def within(cls, floats: np.ndarray) -> Space:
        """Floats that exist, as a space of their own."""
        made = super().__new__(cls, floats.ctypes.data)
        made.floats = floats
        return made


def _place(context: Any, builder: Any, kind: Any, address: Any, index: Any) -> Any:
    """Emit a pointer to a value of a type, with `index` others of it before."""
    count = context.get_constant(types.intp, math.prod(shape_of(kind)[0]))
    pointer = builder.inttoptr(address, _DOUBLE)
    return builder.gep(pointer, [builder.mul(index, count)])


def _floats(address: int, index: int, like: Any) -> Any:
    """The floats of value `index` of the type of `like`."""
    count = np.size(like)
    there = (ctypes.c_double * count).from_address(int(address) + 8 * count * int(index))
    return np.ctypeslib.as_array(there)


def read_at(address: int, index: int, like: Any) -> Any:
    """Value `index` of the type of `like`, a float or made of floats; nothing is checked."""
    numbers = _floats(address, index, like)
    return numbers.reshape(like.shape).copy().view(Vector) if np.ndim(like) else numbers[0]


def write_at(address: int, index: int, value: Any) -> None:
    """Write value `index`, a float or made of floats; nothing is checked."""
    _floats(address, index, value)[:] = np.ravel(value)


@in_kernels(read_at)
def _read_at(context: Any, address: Any, index: Any, like: Any) -> Any:
    signature = like(types.intp, types.intp, like)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return load(context, builder, like, _place(context, builder, like, *values[:2]))

    return signature, generate


@in_kernels(write_at)
def _write_at(context: Any, address: Any, index: Any, value: Any) -> Any:
    signature = types.none(types.intp, types.intp, value)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = _place(context, builder, value, *values[:2])
        store(context, builder, value, values[2], place)
        return context.get_dummy_value()

    return signature, generate


# Functions of libc that kernels call by their names, on whole numbers and addresses alone.

_LIBC = ctypes.CDLL(None)


def _of_libc(name: str, arguments: int, bits: int) -> Callable[..., int]:
    """A function of libc, for kernels and for Python."""
    function = getattr(_LIBC, name)
    function.argtypes = [ctypes.c_int64] * arguments
    function.restype = ctypes.c_int64 if bits == 64 else ctypes.c_int32

    def call(*given: int) -> int:
        return int(function(*map(int, given)))

    @in_kernels(call)
    def _call(context: Any, *given: Any) -> Any:
        if len(given) != arguments or not all(isinstance(kind, types.Integer) for kind in given):
            return None

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kind = ir.FunctionType(ir.IntType(bits), [_WORD] * arguments)
            there = cgutils.get_or_insert_function(builder.module, kind, name)
            returned = builder.call(there, values)
            return builder.sext(returned, _WORD) if bits < 64 else returned

        return types.int64(*[types.int64] * arguments), generate

    call.__name__ = call.__qualname__ = name
    return call


send = _of_libc('send', 4, 64)
recv = _of_libc('recv', 4, 64)
poll = _of_libc('poll', 3, 32)
shutdown = _of_libc('shutdown', 2, 32)
