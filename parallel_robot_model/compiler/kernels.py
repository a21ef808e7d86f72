"""How numerical functions are compiled."""

from __future__ import annotations

import functools
import types
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

import parallel_robot_model.compiler.vector_functions
import parallel_robot_model.compiler.vectors  # noqa: F401 and these
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler.kernel_cache import cache_of
from parallel_robot_model.compiler.numba_parts import CachedDispatcher, CPUDispatcher
from parallel_robot_model.compiler.vectors import INTERPRETED, holds_vectors

Function = TypeVar('Function', bound=Callable[..., Any])


class _Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that Python may call with vectors.

    Numba takes all subclasses of arrays with as many dimensions for one type, whichever came
    first, so vectors of another size would be read with the wrong one.
    """

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        if named or not holds_vectors(arguments):
            return super().__call__(*arguments, **named)
        kinds = tuple(map(numba.typeof, arguments))
        key = tuple(map(id, kinds))
        if key not in self._entries:
            self.compile(kinds)
            self._entries[key] = self.overloads[kinds].entry_point, kinds  # they keep their ids
        return self._entries[key][0](*arguments)

    @functools.cached_property
    def _entries(self) -> dict[tuple[int, ...], Any]:
        """Machine code by the types of its arguments: a hash of theirs is that of whole trees."""
        return {}


class _CachedKernel(_Kernel, CachedDispatcher):
    """A kernel whose machine code is kept on disk."""

    def cache(self) -> Any:
        """Where it is kept."""
        return cache_of(self.py_func)


def kernel(function: Function) -> Function:
    """Compile a function with Numba, cached on disk.

    ``fastmath`` stays off and division by zero gives inf as in IEEE 754: the same input gives the
    same bits wherever a kernel is called from.
    """
    return _cached(function)


def inner(function: Function) -> Function:
    """Compile a function that only kernels call: without a Python wrapper, in less time."""
    return _cached(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def merged(function: Function) -> Function:
    """Compile a small function that becomes a part of the machine code of kernels that call it."""
    return _cached(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)


def _cached(function: Function, **options: bool) -> Function:
    if INTERPRETED:
        return _as_it_is(function)
    compiled = numba.njit(error_model='numpy', **options)(function)
    return cast(Function, _CachedKernel.of(compiled))


def composed(function: Function, **parts: Callable[..., Any]) -> Function:
    """Compile a function that kernels take as FirstClass, with others that it calls inside.

    Args:
        function: The function.
        parts: Kernels that it calls, by the names that they have in it. Its machine code is kept
            with that of the first one.
    """
    first = cast(Any, next(iter(parts.values()))).py_func
    made = types.FunctionType(function.__code__, {**function.__globals__, **parts})
    made.__module__ = first.__module__
    made.__qualname__ = f'{first.__qualname__}.{function.__qualname__}'
    return cast(Function, _cached(made, no_cpython_wrapper=True))


def inlined(function: Function) -> Function:
    """Compile a function as a part of the kernel that calls it.

    For functions that take others, and where handing over many arrays costs more than the work.
    """
    if INTERPRETED:
        return _as_it_is(function)
    compiled = numba.njit(inline='always', error_model='numpy')(function)
    compiled.__class__ = _Kernel
    return cast(Function, compiled)


class _Names:
    """A module of functions with ours in place of some."""

    def __init__(self, module: types.ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._module, name)
        return PYTHON.get(found, found) if callable(found) else found


PYTHON: dict[Any, Any] = {}  # functions of `math` and `numpy` to ours, where nothing is compiled


def _as_it_is(function: Function) -> Function:
    names = cast(Any, function).__globals__
    for name in ('math', 'np'):
        if isinstance(names.get(name), types.ModuleType):
            names[name] = _Names(names[name])
    cast(Any, function).py_func = function  # as compiled functions have it
    return function


def need_compiler() -> None:
    """Refuse to go on without the compiler.

    Raises:
        InputError: it is switched off.
    """
    if INTERPRETED:
        raise InputError('NUMBA_DISABLE_JIT is set; unset it: nodes need the compiler')


def entry_point(function: Callable[..., Any], *example: Any) -> Callable[..., Any]:
    """Compile a kernel for the types of the `example` arguments, and return what runs only that.

    A call of the kernel itself checks the types of its arguments first, which takes longer than
    passing them. Arguments of other types are a TypeError at best.
    """
    need_compiler()
    arguments = tuple(numba.typeof(argument) for argument in example)
    dispatcher = cast(Any, function)
    dispatcher.compile(arguments)
    return cast(Callable[..., Any], dispatcher.overloads[arguments].entry_point)
