"""How machine code is found on disk, with a message when there is none yet.

Numba looks for the cache of a function by the place of its file. Here, kernels of the suite are
found by the name of their module, in the directory of their version, so that all copies of the
same sources share one cache. This builds on private parts of Numba, see
numba_parts.py.
"""

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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from parallel_robot_model.compiler.numba_parts import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
    _CacheLocator,
    loaded_library,
    rtsys,
    symbols_of,
)
from parallel_robot_model.processes import cache_directory
from parallel_robot_model.processes.cache_directory import NOTICE, PREFIX
from parallel_robot_model.processes.user_directory import is_private

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
        """What is kept of a compiled function."""
        return symbols_of(compiled), super().reduce(compiled)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """A compiled function of what was kept of it."""
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
        """Keep other processes from writing the files within the context.

        Raises:
            BlockingIOError: another one keeps them for long, because it was stopped.
        """
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
    """Check that no other user could have written what would be run.

    Raises:
        PermissionError: one could.
    """
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
