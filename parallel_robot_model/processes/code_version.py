"""Which code this is: a hash of all sources of the suite, and one of those of machine code."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import sys
from importlib.metadata import version
from pathlib import Path

KERNELS = (b'@kernel', b'@inner', b'@inlined', b'numba.extending', b'@lower_builtin')
TUPLES = b'(NamedTuple)'  # machine code addresses their members by position
SETTINGS = (  # of Numba, in the environment: they change the machine code of the same source
    'NUMBA_OPT', 'NUMBA_BOUNDSCHECK', 'NUMBA_DEBUGINFO', 'NUMBA_ENABLE_AVX',
    'NUMBA_LOOP_VECTORIZE', 'NUMBA_SLP_VECTORIZE',
)  # fmt: skip
PACKAGE = re.compile('parallel_robot(_[a-z]+)?|trajectory_gen')  # packages of the suite
FROM = re.compile(rb'^from ([\w.]+) import (\([^)]*\)|[^\n]*)', re.MULTILINE)
NAME = re.compile(r'\w+')
LENGTH = 16  # characters of a hash


def root() -> Path:
    """Directory with the packages of the suite."""
    return Path(__file__).resolve().parents[2]


def is_source(file: Path) -> bool:
    """Whether a file (absolute path) belongs to the suite."""
    return file.is_relative_to(root()) and bool(
        PACKAGE.fullmatch(file.relative_to(root()).parts[0])
    )


@functools.cache
def of_suite() -> str:
    """All of it: Python sources of the suite, and what compiles them; not where it lies."""
    digest = _digest(_sources())
    return f'{digest}, {_compiler()}'


def of_kernels() -> str:
    """What machine code depends on, and what compiles it.

    These are the files with kernels and those that they import, for a constant of them is a part
    of the machine code; and all files with classes of tuples, which kernels take.
    """
    sources = {path: text for path, text in _sources().items() if not _is_of_ros(path)}
    names = {path[:-3].removesuffix('/__init__').replace('/', '.'): path for path in sources}
    waiting = [path for path, text in sources.items() if any(mark in text for mark in KERNELS)]
    chosen = {*waiting, *(path for path, text in sources.items() if TUPLES in text)}
    while waiting:
        for package, imported in FROM.findall(sources[waiting.pop()]):
            base = package.decode()
            for name in ('', *NAME.findall(imported.decode())):
                path = names.get(f'{base}.{name}' if name else base)
                if path is not None and path not in chosen:
                    waiting.append(path)
                    chosen.add(path)
    settings = [f'{name}={os.environ[name]}' for name in SETTINGS if name in os.environ]
    text = ' '.join([_compiler(), *settings])
    return _digest({path: sources[path] for path in sorted(chosen)}, text)


def _sources() -> dict[str, bytes]:
    """Content of the Python sources of the suite, by path below the root; at each start."""
    base = f'{root()}/'
    files = [
        f'{folder}/{name}'
        for room in filter(PACKAGE.fullmatch, os.listdir(base))
        for folder, _, names in os.walk(base + room)
        for name in names
        if name.endswith('.py')
    ]
    contents = {}
    for file in sorted(files):
        with open(file, 'rb') as source:
            contents[file.removeprefix(base)] = source.read()
    return contents


def _digest(sources: dict[str, bytes], text: str = '') -> str:
    digest = hashlib.sha256(text.encode())
    for path, content in sources.items():
        digest.update(path.encode() + b'\0' + content)
    return digest.hexdigest()[:LENGTH]


def _compiler() -> str:
    return f'numba {version("numba")}, {sys.implementation.cache_tag}'


def _is_of_ros(path: str) -> bool:
    """Whether it is ROS code, which no kernel uses."""
    name = path.rpartition('/')[2]
    of_nodes = path.startswith('parallel_robot_model/nodes/')
    return of_nodes or name.startswith('ros_') or name.endswith('_node.py')
