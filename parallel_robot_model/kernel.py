"""How numerical functions are compiled, and handed to one another."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numba
from numba import types
from numba.experimental.function_type import FunctionModel
from numba.extending import register_model

from parallel_robot_model.kernel_cache import KernelCache, NoCache

Function = TypeVar('Function', bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function with Numba, cached on disk.

    ``fastmath`` stays off and division by zero gives inf as in IEEE 754: the same input gives the
    same bits wherever a kernel is called from.
    """
    return _cached(function)


def inner(function: Function) -> Function:
    """Compile a function that only kernels call: without what Python would need, in less time."""
    return _cached(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _cached(function: Function, **options: bool) -> Function:
    compiled = numba.njit(error_model='numpy', **options)(function)
    compiled._cache = KernelCache(function)
    return cast(Function, compiled)


def inlined(function: Function) -> Function:
    """Compile a function as a part of the kernel that calls it.

    For functions that take others, and where handing over many arrays costs more than the work.
    """
    return cast(Function, numba.njit(inline='always', error_model='numpy')(function))


@contextlib.contextmanager
def in_memory(*kernels: Any) -> Iterator[None]:
    """Compile kernels without the cache on disk, for arguments of types of a module of one's own.

    The index of a cached kernel holds the types that it was compiled for; other processes, which
    cannot import such a module, could not read it.
    """
    caches = [kernel._cache for kernel in kernels]
    for compiled in kernels:
        compiled._cache = NoCache()
    try:
        yield
    finally:
        for compiled, cache in zip(kernels, caches, strict=True):
            compiled._cache = cache


def entry_point(function: Callable[..., Any], *example: Any) -> Callable[..., Any]:
    """Compile a kernel for the types of the `example` arguments, and give what runs just that.

    A call of the kernel itself looks at the types of its arguments first, which takes longer than
    handing them over. Arguments of other types are a TypeError at best.
    """
    arguments = tuple(numba.typeof(argument) for argument in example)
    dispatcher = cast(Any, function)
    dispatcher.compile(arguments)
    return cast(Callable[..., Any], dispatcher.overloads[arguments].entry_point)


def distinguish(*values: Any) -> None:
    """Make the classes of tuples known to Numba's dispatcher by module and name.

    It tells NamedTuples apart by the names of class and fields, so the ``Memory`` of one law could
    pass for that of another; every call then takes the slow way, ten times as long.
    """
    for kind in map(type, values):
        if issubclass(kind, tuple):
            kind.__name__ = f'{kind.__module__}.{kind.__qualname__}'


class _FunctionType(types.FunctionType):  # type: ignore[misc]
    """Type of a function by address, told apart by the types of its arguments.

    Numba's own goes by the names of the types: two laws whose ``Gains`` have the same number of
    fields would be one type to it.
    """

    @property
    def key(self) -> Any:
        return super().key, self.signature


register_model(_FunctionType)(FunctionModel)


class FirstClass:
    """A kernel as a value: its machine code, by address, for kernels that take a function.

    A kernel that takes one is compiled once for the signature, not again for every function, and
    calls the very code that a direct call runs.
    """

    def __init__(self, function: Callable[..., Any], *example: Any) -> None:
        """Compile `function` for the types of the `example` arguments."""
        dispatcher = cast(Any, function)
        arguments = tuple(numba.typeof(argument) for argument in example)
        dispatcher.compile(arguments)
        compiled = dispatcher.overloads[arguments]
        self.function = function
        self._signature = compiled.signature
        self._address = int(
            compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
        )
        self._numba_type_ = _FunctionType(self._signature)  # spares a search at every call

    def __wrapper_address__(self) -> int:
        """Address of the machine code (Numba's protocol)."""
        return self._address

    def signature(self) -> Any:
        """Signature of the machine code (Numba's protocol)."""
        return self._signature
