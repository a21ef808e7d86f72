"""Python files of users that define a law or a robot."""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from parallel_robot_base.cache_directory import PREFIX
from parallel_robot_base.errors import InputError, ParallelRobotError, first_line
from parallel_robot_base.fields import parameters

MOVED = {  # names that files for older versions import, and where they are now
    ('parallel_robot_control.coupling', 'sig'): 'parallel_robot_control.switching_functions',
    ('parallel_robot_control.coupling', 'saturate'): 'parallel_robot_control.switching_functions',
    ('parallel_robot_interface.errors', 'InputError'): 'parallel_robot_base.errors',
    ('parallel_robot_interface.fields', 'Field'): 'parallel_robot_base.fields',
    ('parallel_robot_model.dynamics', 'Model'): 'parallel_robot_model.contract',
    ('parallel_robot_model.kernel', 'inner'): 'parallel_robot_base.kernel',
    ('parallel_robot_model.kernel', 'kernel'): 'parallel_robot_base.kernel',
    ('parallel_robot_model.kinematics', 'inverse'): 'parallel_robot_base.linear_algebra',
    ('parallel_robot_model.kinematics', 'multiply'): 'parallel_robot_base.linear_algebra',
}

_loaded: dict[tuple[str, bytes], ModuleType] = {}  # by name and source


def load(
    path: str, key: str, needed: Sequence[str], groups: Sequence[str]
) -> tuple[str, ModuleType]:
    """Import a file once.

    Args:
        path: The file; its stem is the name of the law or robot.
        key: Key of the configuration that names it, for messages.
        needed: Attributes that it must have.
        groups: Those of them that must be NamedTuples of parameters.

    Returns:
        Name and module.

    Raises:
        InputError: the file does not exist, cannot be imported, or an attribute is missing
            or wrong.
    """
    try:
        file = Path(path).expanduser().resolve()
        exists, is_file = file.exists(), file.is_file()
    except (OSError, RuntimeError, ValueError):  # too long, home of an unknown user, not a text
        exists = is_file = False
    if not exists:
        raise InputError(f'{key}: {path} does not exist')
    if file.suffix != '.py' or not file.stem.isidentifier() or not is_file:
        raise InputError(f'{key}: {path} is not a Python file whose name is an identifier')
    try:
        module = _module(file)
    except (Exception, SystemExit) as error:  # custom code may raise anything
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
    except Exception as error:
        raise InputError(f'{what}: {first_line(error)}') from error


def source_of(module: ModuleType) -> bytes:
    """Source of a module that was loaded; its file may no longer exist."""
    return next(source for (_, source), loaded in _loaded.items() if loaded is module)


@functools.cache
def _module(file: Path) -> ModuleType:
    """The module of a file; a copy of a file that was loaded is the same module."""
    key = file.stem, file.read_bytes()
    if key not in _loaded:
        _loaded[key] = _import(file, key[1])
    return _loaded[key]


def _import(file: Path, source: bytes) -> ModuleType:
    # Numba tells tuples apart by the names of module and class: two files must not share one.
    # Machine code is kept under the name, too, so that it belongs to this source.
    digest = hashlib.sha256(bytes(file) + b'\0' + source).hexdigest()[:16]
    name = f'{PREFIX}{file.stem}_{digest}'
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None  # a .py file always has one
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    tree = _Renamer().visit(ast.parse(source, str(file)))
    exec(compile(ast.fix_missing_locations(tree), str(file), 'exec'), vars(module))
    for kind in vars(module).values():
        if isinstance(kind, type) and issubclass(kind, tuple) and kind.__module__ == name:
            kind.__name__ = f'{name}.{kind.__qualname__}'
    return module


class _Renamer(ast.NodeTransformer):
    """Lets files for older versions import names from where they are now."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> list[ast.ImportFrom]:
        """Split an import by the modules that have its names now."""
        found: dict[str | None, list[ast.alias]] = {}
        for name in node.names:
            module = MOVED.get((node.module or '', name.name), node.module)
            found.setdefault(module, []).append(name)
        return [
            ast.copy_location(ast.ImportFrom(module, names, node.level), node)
            for module, names in found.items()
        ]
