"""How a Python file of a user's is executed, and that in a separate process first.

The file may end its process or never return: in that other process it can, and is refused.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.processes import cache_directory, trial_process
from parallel_robot_model.processes.imported_sources import imported_sources
from parallel_robot_model.processes.tuple_classes import classes_of, distinguish

Rehearse = Callable[[ModuleType], None]


def try_file(file: Path, source: bytes, rehearse: Rehearse) -> None:
    """Import a file in a separate process, once for each version of its source.

    Args:
        file: The file.
        source: Its source.
        rehearse: Function of a module of the suite: it calls what the file defines in Python.

    Raises:
        InputError: it cannot be imported, or it ends its process, or does not return.
    """
    digest = hashlib.sha256(source).hexdigest()
    mark = f'imported_{digest[:16]}'
    if cache_directory.marked(mark) is not None:
        return
    names = [rehearse.__module__, rehearse.__name__]
    ended = trial_process.run(__name__, {'file': str(file), 'digest': digest, 'rehearse': names})
    if not ended.returned:
        raise InputError(f'{file}: {ended.how}')
    cache_directory.mark(mark)


def import_file(file: Path, source: bytes) -> ModuleType:
    """Execute a file as a module of a name of its own."""
    # Numba tells tuples apart by the names of module and class: two files must not share one.
    # Machine code is kept under the name, too: copies share it, unless they look where they lie.
    place = bytes(file) + b'\0' if b'__file__' in source else b''
    content = place + source + imported_sources(source)
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
    distinguish(*classes_of(module))
    return module


def _trial(task: dict[str, Any]) -> None:
    """Import the file of a task, and call what it has in Python."""
    file = Path(task['file'])
    source = file.read_bytes()
    if hashlib.sha256(source).hexdigest() != task['digest']:
        raise InputError('has changed since it was read')
    with trial_process.step('its import'):
        module = import_file(file, source)
    where, name = task['rehearse']
    getattr(import_module(where), name)(module)


if __name__ == '__main__':
    trial_process.serve(_trial)
