"""What a Python file imports of a user's own: machine code depends on it as on the file."""

from __future__ import annotations

import ast
import sys
import warnings
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path

from parallel_robot_model.processes import cache_directory

INSTALLED = {'site-packages', 'dist-packages'}  # folders of what pip and Debian install

_seen: dict[str, bytes] = {}  # sources of modules that are imported, which may have changed since


def imported_sources(source: bytes) -> bytes:
    """Sources of the modules that a file imports, and of those that these import.

    What is installed, and the suite, are left out.

    Args:
        source: The file; empty where it is not valid Python.
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
