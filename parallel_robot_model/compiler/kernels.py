"""How numerical functions are compiled."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import inspect
import logging
import os
import pickle
import re
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

import parallel_robot_model.compiler.vector_functions  # noqa: F401 what vectors are in kernels
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler.numba_parts import (
    CachedDispatcher,
    CompileResultCacheImpl,
    CPUDispatcher,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
    _CacheLocator,
    loaded_library,
    rtsys,
    symbols_of,
)
from parallel_robot_model.compiler.vectors import INTERPRETED, holds_vectors
from parallel_robot_model.processes import cache_directory
from parallel_robot_model.processes.cache_directory import NOTICE, PREFIX
from parallel_robot_model.processes.user_directory import is_private

# How machine code is found on disk, with a message when there is none yet.
#
# Numba looks for the cache of a function by the place of its file. Here, kernels of the suite are
# found by the name of their module, in the directory of their version, so that all copies of the
# same sources share one cache. This builds on private parts of Numba, see
# numba_parts.py.

UNREADABLE = (OSError, EOFError, ImportError, AttributeError, pickle.UnpicklingError)
PROGRESS_INTERVAL = 10.0  # s, between two lines of progress
LOCK_TIMEOUT, LOCK_POLL = 5.0, 0.002  # s, to wait for the lock of an index, and between two looks
CUSTOM = re.compile(rf'{PREFIX}\w+(?=\.)')  # names of custom modules in names of types


class _Place(_CacheLocator):  # type: ignore[misc]
    """Where the machine code of a function lies, and the version of its source."""

    def __init__(self, function: Any) -> None:
        file = Path(inspect.getfile(function)).resolve()
        self._line = function.__code__.co_firstlineno
        own = cache_directory.OWN
        if cache_directory.is_source(file):
            self._path = os.path.join(own, function.__module__)
            self._stamp = ''  # the directory depends on it already
        elif function.__module__.startswith(PREFIX):
            self._path, self._stamp = cache_directory.custom(function.__module__), ''
        else:
            folder = hashlib.sha256(bytes(file.parent)).hexdigest()[:16]
            self._path = os.path.join(own, f'{file.stem}_{folder}')
            self._stamp = hashlib.sha256(file.read_bytes()).hexdigest()

    def get_cache_path(self) -> str:
        """Directory."""
        return self._path

    def get_source_stamp(self) -> str:
        """Hash of the source."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Line of the function."""
        return str(self._line)

    @classmethod
    def from_function(cls, function: Any, file: Any) -> _Place:
        """The place of a function."""
        return cls(function)


class _Files(CompileResultCacheImpl):  # type: ignore[misc]
    """Files of the machine code of a function."""

    def __init__(self, function: Any) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Place(function)
        self._locator.ensure_cache_path()
        _check_private(self._locator.get_cache_path())
        name = f'{function.__module__.rpartition(".")[2]}.{function.__qualname__}'
        self._filename_base = self.get_filename_base(name, getattr(sys, 'abiflags', ''))

    def reduce(self, compiled: Any) -> Any:
        """What is saved of a compiled function."""
        return symbols_of(compiled), super().reduce(compiled)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """A compiled function from what was saved of it."""
        symbols, state = payload
        codegen = target_context.codegen()
        codegen.unserialize_library = functools.partial(loaded_library, symbols, codegen)
        try:
            return super().rebuild(target_context, state)
        finally:
            del codegen.unserialize_library


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The cache of one kernel: it reports what it does not have.

    Machine code for types of a custom module lies in a directory of that module: processes that
    have not imported it cannot read an index with its types.
    """

    _impl_class = _Files

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Load the machine code for a signature; None if there is none that can be read.

        Numba would first prepare to compile, which takes a third of a second; the compiler does so
        itself. What is loaded needs the run time alone.
        """

        def initialise() -> None:
            del context.refresh  # so that compiling refreshes as usual
            rtsys.initialize(context)

        context.refresh = initialise
        overload = None
        try:
            with contextlib.suppress(*UNREADABLE), self._files_of(signature):
                overload = super().load_overload(signature, context)
                if overload is not None and tuple(overload.signature.args) != tuple(signature):
                    overload = None  # two processes have written one file
                    with self._alone():
                        self._cache_file.flush()
        finally:
            vars(context).pop('refresh', None)
        if overload is None:
            _announce()
        return overload

    def save_overload(self, signature: Any, data: Any) -> None:
        """Save machine code, if there is a place for it; a full disk is not an error.

        An index that cannot be read is replaced by a new one. Numba reads the index and writes it
        anew, so only one process may do so at a time: else the other's code is lost, or both use
        one file.
        """
        with contextlib.suppress(OSError), self._files_of(signature):
            os.makedirs(self._cache_file._cache_path, exist_ok=True)
            with self._alone():
                try:
                    super().save_overload(signature, data)
                except UNREADABLE:
                    self._cache_file.flush()
                    super().save_overload(signature, data)
            _report()

    @contextlib.contextmanager
    def _files_of(self, signature: Any) -> Iterator[None]:
        """Use the files for a signature within the context.

        Each has an index of its own: to read one with all signatures takes longer than the code.
        """
        usual = self._cache_file
        text = str(signature)
        folder, base, stamp = usual._cache_path, self._impl.filename_base, usual._source_stamp
        custom = sorted(set(CUSTOM.findall(text)))
        if custom:
            folder = cache_directory.custom('_and_'.join(custom))
            base, stamp = f'{self._py_func.__module__}.{base}', ''
            if os.path.exists(folder):
                _check_private(folder)
        base = f'{base}.{hashlib.sha256(text.encode()).hexdigest()[:16]}'
        self._cache_file: Any = IndexDataCacheFile(folder, base, stamp)
        try:
            yield
        finally:
            self._cache_file = usual

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other processes from writing the files within the context."""
        with open(os.path.join(self._cache_file._cache_path, 'lock'), 'ab') as file:
            due = time.monotonic() + LOCK_TIMEOUT
            while True:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > due:
                        raise
                    time.sleep(LOCK_POLL)
                except OSError:  # there are no locks on this file system
                    break
            yield


class NoCache(NullCache):  # type: ignore[misc]
    """The cache of a kernel where there is no place for one."""

    def load_overload(self, signature: Any, context: Any) -> None:
        """Report that there is no machine code."""
        _announce()


def cache_of(function: Any) -> KernelCache | NoCache:
    """The cache of a function; one that keeps nothing where there is no place for it."""
    if cache_directory.OWN:
        with contextlib.suppress(OSError):
            return KernelCache(function)
    return NoCache()


@functools.cache
def _check_private(folder: str) -> None:
    """Check that no other user could have written what would be run."""
    if not is_private(folder):
        _warn(folder)
        raise PermissionError(folder)


@functools.cache
def _warn(folder: str) -> None:
    """Say once whose machine code is not used."""
    logging.getLogger('parallel_robot').warning(
        f'{folder} can be written by other users: machine code is neither read nor kept there'
    )


@functools.cache
def _announce() -> None:
    """Report once that something is being compiled."""
    logging.getLogger('parallel_robot').info(NOTICE)


os.register_at_fork(after_in_child=_announce.cache_clear)  # a node has its own log


def _report() -> None:
    """Report the progress from time to time."""
    global _due
    if time.monotonic() >= _due:
        _due = time.monotonic() + PROGRESS_INTERVAL
        text = cache_directory.compiled()
        if text:
            logging.getLogger('parallel_robot').info(text)


_due = time.monotonic() + PROGRESS_INTERVAL


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


def internal(function: Function) -> Function:
    """Compile a function that only kernels call: without a Python wrapper, in less time."""
    return _cached(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def inline_llvm(function: Function) -> Function:
    """Compile a small function that becomes a part of the machine code of kernels that call it."""
    return _cached(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)


def _cached(function: Function, **options: bool) -> Function:
    if INTERPRETED:
        return _interpreted(function)
    compiled = numba.njit(error_model='numpy', **options)(function)
    return cast(Function, _CachedKernel.of(compiled))


def specialize(function: Function, **parts: Callable[..., Any]) -> Function:
    """Compile a function that kernels take as FunctionValue, with others that it calls inside.

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


def inline_ir(function: Function) -> Function:
    """Compile a function as a part of the kernel that calls it.

    For functions that take others, and where handing over many arrays costs more than the work.
    """
    if INTERPRETED:
        return _interpreted(function)
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


def _interpreted(function: Function) -> Function:
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


# Why a kernel of a custom module does not compile, in one line.

COLORS = re.compile(r'\x1b\[[0-9;]*m')  # Numba's, where colorama is installed


def reason(error: Exception, function: Any) -> str:
    """The cause and the line that Numba reports; failing that, the line of the function."""
    text = COLORS.sub('', str(error))
    lines = [line.strip() for line in text.splitlines()]
    said = [line for line in lines if line and not line.startswith('Failed in ')]
    cause = said[0] if said else type(error).__name__
    if cause.endswith(':'):
        cause = ' '.join(said[:2])
    cause, _, raised = cause.partition('. Raised from ')
    place = re.search(r'^File "(.*)", line (\d+):$', text, re.MULTILINE)
    place = place or re.fullmatch(r'(.*) \((\d+)\)', raised or str(getattr(error, 'loc', '')))
    code = function.__code__
    file, line = place.groups() if place else (code.co_filename, code.co_firstlineno)
    return f'{cause} ({Path(file).name}:{line})'
