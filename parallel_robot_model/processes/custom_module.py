"""Python files of users that define a law, a robot or a trajectory."""

from __future__ import annotations

import contextlib
import functools
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

from parallel_robot_model.common.errors import InputError, ParallelRobotError, first_line
from parallel_robot_model.configuration.fields import parameters
from parallel_robot_model.processes.custom_import import Rehearse, import_file, try_file

SLOW = 3.0  # s, after which the file being loaded is named

RAISED = (Exception, SystemExit)  # by custom code: sys.exit() is a mistake, too

_loaded: dict[tuple[str, bytes], ModuleType] = {}  # by name and source
_held: dict[Path, bytes] = {}  # source by file, whatever is in the file


def load(
    path: str,
    key: str,
    needed: Sequence[str],
    groups: Sequence[str],
    rehearse: Rehearse,
    stands_for: Callable[[Path], bytes] | None = None,
) -> tuple[str, ModuleType]:
    """Import a file once, in a separate process first.

    Args:
        path: The file; its stem is the name of what it defines.
        key: Key of the configuration that names it, for messages.
        needed: Attributes that it must have.
        groups: Those of them that must be NamedTuples of parameters.
        rehearse: Calls in that process what the file defines in Python.
        stands_for: The source that stands for the file, which is not Python.

    Returns:
        Name and module.

    Raises:
        InputError: the file does not exist, cannot be imported, ends its process or does not
            return, or an attribute is missing or wrong.
    """
    try:
        file = Path(path).expanduser().resolve()
        exists, is_file = file.exists(), file.is_file()
    except (OSError, RuntimeError, ValueError):  # too long, home of an unknown user, not a text
        exists = is_file = False
    if not exists:
        raise InputError(f'{key}: {path} does not exist')
    kind = 'Python file' if stands_for is None else 'file'
    if (
        (stands_for is None and file.suffix != '.py')
        or not file.stem.isidentifier()
        or not is_file
    ):
        raise InputError(f'{key}: {path} is not a {kind} whose name is an identifier')
    try:
        module = _module(file, rehearse, stands_for)
    except InputError as error:
        raise InputError(f'{key}: {error}') from None
    except RAISED as error:
        raise InputError(f'{key}: {file}: {first_line(error)}') from error
    for attribute in needed:
        if not hasattr(module, attribute):
            raise InputError(f'{key}: {file} has no {attribute}')
    for name in groups:
        if not hasattr(getattr(module, name), '_fields'):
            raise InputError(f'{key}: {path}: {name} is not a NamedTuple')
        with blaming(f'{key}: {path}'):  # its annotations
            parameters(getattr(module, name))
    return file.stem, module


@contextlib.contextmanager
def blaming(what: str) -> Iterator[None]:
    """Turn errors of custom code into an InputError that names its origin."""
    try:
        yield
    except ParallelRobotError:
        raise
    except RAISED as error:
        raise InputError(f'{what}: {first_line(error)}') from error


def source_of(module: ModuleType) -> bytes:
    """Source of a module that was loaded; its file may no longer exist."""
    return next(source for (_, source), loaded in _loaded.items() if loaded is module)


def hold(file: Path, source: bytes) -> None:
    """Let a file that was written here have this source, whoever changes it from now on."""
    _held[file.resolve()] = source


@functools.cache
def _module(
    file: Path, rehearse: Rehearse, stands_for: Callable[[Path], bytes] | None
) -> ModuleType:
    """The module of a file; a copy of a file that was loaded is the same module."""
    source = _held.get(file) or (stands_for or Path.read_bytes)(file)
    key = file.stem, source
    if key not in _loaded:
        with _telling(f'loading {file} has taken {SLOW:g} s so far'):
            if stands_for is None:  # else it is ours
                try_file(file, source, rehearse)
            _loaded[key] = import_file(file, source)
    return _loaded[key]


@contextlib.contextmanager
def _telling(text: str) -> Iterator[None]:
    """Say something to the user if the context takes long."""
    timer = threading.Timer(SLOW, logging.getLogger('parallel_robot').warning, [text])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
