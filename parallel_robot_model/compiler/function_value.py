"""Kernels as values, for kernels that take a function."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, cast

import numba
from numba import types
from numba.extending import register_model

from parallel_robot_model.compiler.numba_parts import FunctionModel, address_of
from parallel_robot_model.compiler.vectors import INTERPRETED, divisible


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

    Attributes:
        function: The kernel.
        compiled: What Numba has made of it; not there where kernels are interpreted.
    """

    compiled: Any

    def __init__(self, function: Callable[..., Any], *example: Any) -> None:
        """Compile `function` for the types of the `example` arguments."""
        self.function = function
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
