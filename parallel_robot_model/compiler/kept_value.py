"""A value that kernels keep by its address, whatever its type: who keeps it need not know that.

Its memory has room for three values, one after the other: two of which one is present and the next
one is written to the other, so that it can be dropped, and the first one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.boxed import plain, plain_type, read_plain
from parallel_robot_model.compiler.numba_parts import in_kernels

ALIGNMENT = 64  # bytes, of the widest register
HEAD = 64  # bytes, before the values: the number of the present one
FIRST = 2  # number of the first value

_WORD = ir.IntType(64)


class KeptValue(int):
    """Address of a value that has a plain_type, which lives as long as this.

    Attributes:
        first: The value that it begins with.
    """

    first: Any
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


def _place(context: Any, builder: Any, kind: Any, address: Any, number: Any) -> Any:
    """Emit a pointer to a value of a type."""
    data = context.get_value_type(kind)
    step = -(-context.get_abi_sizeof(data) // ALIGNMENT) * ALIGNMENT
    start = builder.add(address, builder.add(_WORD(HEAD), builder.mul(number, _WORD(step))))
    return builder.inttoptr(start, data.as_pointer())


@in_kernels(present)
def _present(context: Any, kept: Any, like: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = builder.load(_number(builder, values[0]))
        return builder.load(_place(context, builder, like, values[0], number))

    return like(types.intp, like), generate


@in_kernels(propose)
def _propose(context: Any, kept: Any, value: Any, like: Any) -> Any:
    if value != like:
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = _other(builder, builder.load(_number(builder, values[0])))
        builder.store(values[1], _place(context, builder, value, values[0], number))
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
