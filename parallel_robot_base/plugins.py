"""Control laws of one's own, from Python files that are not part of the suite."""

from __future__ import annotations

import functools
import importlib.util
import sys
import zlib
from pathlib import Path
from types import ModuleType

from parallel_robot_base.errors import InputError, first_line
from parallel_robot_base.fields import parameters

NEEDED = ('Gains', 'initial_memory', 'update')

_loaded: dict[tuple[str, bytes], ModuleType] = {}  # by name and source


def load(path: str) -> tuple[str, ModuleType]:
    """Import a law file once.

    Args:
        path: The file; its stem is the name of the law.

    Returns:
        Name and module.

    Raises:
        InputError: the file does not exist, cannot be imported or is not a law.
    """
    try:
        file = Path(path).expanduser().resolve()
        exists, is_file = file.exists(), file.is_file()
    except (OSError, RuntimeError, ValueError):  # too long, of nobody's home, not of text
        exists = is_file = False
    if not exists:
        raise InputError(f'own_laws: {path} does not exist')
    if file.suffix != '.py' or not file.stem.isidentifier() or not is_file:
        raise InputError(f'own_laws: {path} is not a Python file whose name can name a law')
    return file.stem, _module(file)


def source_of(law: ModuleType) -> bytes:
    """Source of a law that was loaded; its file may have gone."""
    return next(source for (_, source), module in _loaded.items() if module is law)


@functools.cache
def _module(file: Path) -> ModuleType:
    """The module of a file; a copy of a file that is known is the same law."""
    key = file.stem, file.read_bytes()
    if key not in _loaded:
        _loaded[key] = _import(file)
    return _loaded[key]


def _import(file: Path) -> ModuleType:
    # Numba tells tuples apart by the names of module and class: two files must not share one.
    name = f'parallel_robot_own_{file.stem}_{zlib.crc32(bytes(file)):08x}'
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None  # of a .py file there always is one
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever the code of somebody else may raise
        raise InputError(f'own_laws: {file}: {first_line(error)}') from error
    for attribute in NEEDED:
        if not hasattr(module, attribute):
            raise InputError(f'own_laws: {file} has no {attribute}: it is not a law')
    if not hasattr(module.Gains, '_fields'):
        raise InputError(f'own_laws: {file}: Gains is not a NamedTuple')
    try:
        parameters(module.Gains)
    except Exception as error:  # of its annotations
        raise InputError(f'own_laws: {file}: {first_line(error)}') from error
    return module
