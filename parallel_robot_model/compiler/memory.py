"""Memory that kernels read and write by its address."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels
from parallel_robot_model.compiler.vectors import Vector, load, shape_of, store

_WORD = ir.IntType(64)

# Memory that kernels reach by its address, which a boxed tuple can hold; arrays it cannot.

_DOUBLE = ir.DoubleType().as_pointer()


class FloatBuffer(int):
    """Address of floats, which live as long as it does."""

    floats: np.ndarray

    def __new__(cls, count: int) -> FloatBuffer:
        """Make room for `count` floats, all zero."""
        floats = np.zeros(count)
        made = super().__new__(cls, floats.ctypes.data)
        made.floats = floats
        return made


def _pointer_at(context: Any, builder: Any, kind: Any, address: Any, index: Any) -> Any:
    """Emit a pointer to a value of a type, with `index` others of it before."""
    count = context.get_constant(types.intp, math.prod(shape_of(kind)[0]))
    pointer = builder.inttoptr(address, _DOUBLE)
    return builder.gep(pointer, [builder.mul(index, count)])


def _floats(address: int, index: int, template: Any) -> Any:
    """The floats of value `index` of the type of `template`."""
    count = np.size(template)
    there = (ctypes.c_double * count).from_address(int(address) + 8 * count * int(index))
    return np.ctypeslib.as_array(there)


def read_at(address: int, index: int, template: Any) -> Any:
    """Value `index` of the type of `template`, a float or made of floats; nothing is checked."""
    numbers = _floats(address, index, template)
    return numbers.reshape(template.shape).copy().view(Vector) if np.ndim(template) else numbers[0]


def write_at(address: int, index: int, value: Any) -> None:
    """Write value `index`, a float or made of floats; nothing is checked."""
    _floats(address, index, value)[:] = np.ravel(value)


@in_kernels(read_at)
def _read_at(context: Any, address: Any, index: Any, template: Any) -> Any:
    signature = template(types.intp, types.intp, template)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return load(
            context, builder, template, _pointer_at(context, builder, template, *values[:2])
        )

    return signature, generate


@in_kernels(write_at)
def _write_at(context: Any, address: Any, index: Any, value: Any) -> Any:
    signature = types.none(types.intp, types.intp, value)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = _pointer_at(context, builder, value, *values[:2])
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
