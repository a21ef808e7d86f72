"""How numerical functions are compiled."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numba

from parallel_robot_base.kernel_cache import NoCache, cache_of

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
    compiled._cache = cache_of(function)
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
