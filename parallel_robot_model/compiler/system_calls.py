"""Functions of libc that kernels call by their names, on whole numbers and addresses alone."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.numba_parts import cgutils, in_kernels

_WORD = ir.IntType(64)
_LIBC = ctypes.CDLL(None)


def _of_libc(name: str, arguments: int, bits: int) -> Callable[..., int]:
    """A function of libc, for kernels and for Python.

    Args:
        name: Its name.
        arguments: How many it takes: integers of any size and addresses.
        bits: Size of the integer that it returns.
    """
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
