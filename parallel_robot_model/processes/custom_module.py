"""Python files of users that define a law, a robot or a trajectory."""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import logging
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from importlib.machinery import PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from parallel_robot_model.common.errors import InputError, ParallelRobotError, first_line
from parallel_robot_model.configuration.fields import parameters
from parallel_robot_model.processes import cache_directory, child_process

# What a Python file imports of a user's own: machine code depends on it as on the file.

INSTALLED = {'site-packages', 'dist-packages'}  # folders of what pip and Debian install

_seen: dict[str, bytes] = {}  # sources of modules that are imported, which may have changed since


def _imported_sources(source: bytes) -> bytes:
    """Sources of the modules that a file imports, and of those that these import.

    What is installed, and the suite, are left out.
    """
    contents: dict[str, bytes] = {}
    waiting = [*_names(source)]
    while waiting:
        name = waiting.pop()
        if name not in contents:
            contents[name] = _content(name)
            waiting += _names(contents[name])
    return b''.join(
        name.encode() + b'\0' + contents[name] for name in sorted(contents) if contents[name]
    )


def _content(name: str) -> bytes:
    """Source of an outermost module of a user's own; of a package, all of its files."""
    if name in sys.modules and name in _seen:
        return _seen[name]
    spec = PathFinder.find_spec(name)
    origin = Path(spec.origin).resolve() if spec is not None and spec.origin else None
    if origin is None or origin.suffix != '.py' or _is_installed(origin):
        return b''
    files = sorted(origin.parent.rglob('*.py')) if origin.stem == '__init__' else [origin]
    _seen[name] = b'\n'.join(file.read_bytes() for file in files)
    return _seen[name]


def _is_installed(file: Path) -> bool:
    return cache_directory.is_source(file) or not INSTALLED.isdisjoint(file.parts)


def _names(source: bytes) -> Iterator[str]:
    """Names of the outermost modules that a source imports, but for those of Python."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # Python gives them at the import
            nodes = [*ast.walk(ast.parse(source))]
    except (SyntaxError, ValueError, RecursionError):
        return
    for node in nodes:
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module]
        for name in names:
            outermost = name.partition('.')[0]
            if outermost not in sys.stdlib_module_names:
                yield outermost


# Names of classes of tuples, by which Numba tells them apart and machine code is found.


def qualify_type_names(*kinds: type) -> None:
    """Name classes of tuples by module and name; other classes stay as they are.

    Numba's dispatcher tells NamedTuples apart by the names of class and fields, so the ``Memory``
    of one law could pass for that of another; every call then takes the slow path, ten times as
    long. Numba's type of a class keeps the name that the class had when Numba first saw it, and
    machine code is found by that name. So a class is named before any kernel makes such a tuple;
    otherwise it depends on the order of compilation whether its code is found.
    """
    for kind in kinds:
        if issubclass(kind, tuple):
            kind.__name__ = f'{kind.__module__}.{kind.__qualname__}'


def classes_of(module: Any) -> list[type]:
    """Classes of tuples that a module defines."""
    kinds = [kind for kind in vars(module).values() if isinstance(kind, type)]
    return [k for k in kinds if issubclass(k, tuple) and k.__module__ == module.__name__]


# How a Python file of a user's is executed, and that in a separate process first.
#
# The file may end its process or never return: in that other process it can, and is refused.

DryRun = Callable[[ModuleType], None]


def _try_file(file: Path, source: bytes, dry_run: DryRun) -> None:
    """Import a file in a separate process, once for each version of its source."""
    digest = hashlib.sha256(source).hexdigest()
    mark = f'imported_{digest[:16]}'
    if cache_directory.marked(mark) is not None:
        return
    names = [dry_run.__module__, dry_run.__name__]
    result = child_process.run_trial(
        __name__, {'file': str(file), 'digest': digest, 'rehearse': names}
    )
    if not result.returned:
        raise InputError(f'{file}: {result.how}')
    cache_directory.mark(mark)


def import_file(file: Path, source: bytes) -> ModuleType:
    """Execute a file as a module of a name of its own."""
    # Numba tells tuples apart by the names of module and class: two files must not share one.
    # Machine code is kept under the name, too: copies share it, unless they look where they lie.
    place = bytes(file) + b'\0' if b'__file__' in source else b''
    content = place + source + _imported_sources(source)
    digest = hashlib.sha256(content).hexdigest()[:16]
    name = f'{cache_directory.PREFIX}{file.stem}_{digest}'
    # Whatever the file is called, the source is Python.
    loader = SourceFileLoader(name, str(file))
    spec = importlib.util.spec_from_file_location(name, file, loader=loader)
    assert spec is not None  # with a loader there always is one
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    process = os.getpid()
    try:
        exec(compile(source, str(file), 'exec'), vars(module))
    finally:
        if os.getpid() != process:  # a copy that the file has forked: one command is enough
            os._exit(1)
    qualify_type_names(*classes_of(module))
    return module


def _trial(task: dict[str, Any]) -> None:
    """Import the file of a task, and call what it has in Python."""
    file = Path(task['file'])
    source = file.read_bytes()
    if hashlib.sha256(source).hexdigest() != task['digest']:
        raise InputError('has changed since it was read')
    with child_process.trial_step('its import'):
        module = import_file(file, source)
    where, name = task['rehearse']
    getattr(import_module(where), name)(module)


SLOW = 3.0  # s, after which the file being loaded is named

RAISED = (Exception, SystemExit)  # by custom code: sys.exit() is a mistake, too

_loaded: dict[tuple[str, bytes], ModuleType] = {}  # by name and source
_pinned: dict[Path, bytes] = {}  # source by file, whatever is in the file


def load(
    path: str,
    key: str,
    needed: Sequence[str],
    groups: Sequence[str],
    dry_run: DryRun,
    translate: Callable[[Path], bytes] | None = None,
) -> tuple[str, ModuleType]:
    """Import a file once, in a separate process first.

    Args:
        path: The file; its stem is the name of what it defines.
        key: Key of the configuration that names it, for messages.
        needed: Attributes that it must have.
        groups: Those of them that must be NamedTuples of parameters.
        dry_run: Calls in that process what the file defines in Python.
        translate: The source that stands for the file, which is not Python.

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
    kind = 'Python file' if translate is None else 'file'
    if (translate is None and file.suffix != '.py') or not file.stem.isidentifier() or not is_file:
        raise InputError(f'{key}: {path} is not a {kind} whose name is an identifier')
    try:
        module = _module(file, dry_run, translate)
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
        with wrap_user_errors(f'{key}: {path}'):  # its annotations
            parameters(getattr(module, name))
    return file.stem, module


@contextlib.contextmanager
def wrap_user_errors(what: str) -> Iterator[None]:
    """Turn errors of custom code into an InputError that names its origin."""
    try:
        yield
    except ParallelRobotError:
        raise
    except RAISED as error:
        raise InputError(f'{what}: {first_line(error)}') from error


def source_of(loaded: Any) -> bytes:
    """Source of what was made of a module that was loaded; its file may no longer exist."""
    name = loaded.__name__
    return next(source for (_, source), module in _loaded.items() if module.__name__ == name)


def verdict_of(name: str, loaded: Any, kind: str, trial: str, task: Mapping[str, Any]) -> str:
    """What a trial warns of, once for each version of a source.

    Args:
        name: What is tried.
        loaded: What was made of its module.
        kind: Of the trial; what is known of others says nothing of this one.
        trial: Module that serves it, in a process that checks the bounds of arrays: a function of
            the task with the `file`, which returns a text by 'refused' or by 'warnings'.
        task: Plain data.

    Raises:
        InputError: it is refused, or ends its process.
    """
    source = source_of(loaded)
    mark = f'{kind}_{hashlib.sha256(source).hexdigest()[:16]}'
    cached = cache_directory.marked(mark)
    if cached is not None:
        return cached
    with tempfile.TemporaryDirectory() as directory:
        file = Path(loaded.__file__)
        if not file.is_file() or file.read_bytes() != source:  # changed since
            file = Path(directory, f'{name}.py')
            file.write_bytes(source)
        cache = cache_directory.subdirectory('checked') or directory
        environment = {'NUMBA_BOUNDSCHECK': '1', 'NUMBA_CACHE_DIR': cache}
        result = child_process.run_trial(trial, {'file': str(file), **task}, **environment)
    refused = result.result.get('refused') if result.returned else result.how
    if refused:
        raise InputError(f'{name}: {refused}')
    cache_directory.mark(mark, result.result['warnings'])
    return str(result.result['warnings'])


def pin_source(file: Path, source: bytes) -> None:
    """Let a file that was written here have this source, whoever changes it from now on."""
    _pinned[file.resolve()] = source


@functools.cache
def _module(file: Path, dry_run: DryRun, translate: Callable[[Path], bytes] | None) -> ModuleType:
    """The module of a file; a copy of a file that was loaded is the same module."""
    source = _pinned.get(file) or (translate or Path.read_bytes)(file)
    key = file.stem, source
    if key not in _loaded:
        with _warn_if_slow(f'loading {file} has taken {SLOW:g} s so far'):
            if translate is None:  # else it is ours
                _try_file(file, source, dry_run)
            _loaded[key] = import_file(file, source)
    return _loaded[key]


@contextlib.contextmanager
def _warn_if_slow(text: str) -> Iterator[None]:
    """Say something to the user if the context takes long."""
    timer = threading.Timer(SLOW, logging.getLogger('parallel_robot').warning, [text])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


if __name__ == '__main__':
    child_process.serve_trial(_trial)
