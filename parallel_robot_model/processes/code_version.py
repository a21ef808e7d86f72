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
    sources = _sources()
    names = {_module(path): path for path in sources}
    waiting = [
        path
        for path, content in sources.items()
        if any(mark in content for mark in KERNELS) and not _is_of_ros(path)
    ]
    chosen = {*waiting, *(path for path, content in sources.items() if TUPLES in content)}
    while waiting:
        for package, imported in FROM.findall(sources[waiting.pop()]):
            base = package.decode()
            words = [base, *(f'{base}.{name}' for name in imported.decode().split())]
            for path in (names.get(re.sub(r'[^\w.]', '', word)) for word in words):
                if path is not None and path not in chosen:
                    waiting.append(path)
                    chosen.add(path)
    chosen = {path for path in chosen if not _is_of_ros(path)}
    settings = [f'{name}={os.environ[name]}' for name in SETTINGS if name in os.environ]
    text = ' '.join([_compiler(), *settings])
    return _digest({path: sources[path] for path in sorted(chosen)}, text)


def _sources() -> dict[Path, bytes]:
    """Content of the Python sources of the suite, by path below the root."""
    rooms = [path for path in root().iterdir() if PACKAGE.fullmatch(path.name)]
    files = sorted(path for room in rooms for path in room.rglob('*.py'))
    return {path.relative_to(root()): path.read_bytes() for path in files}


def _digest(sources: dict[Path, bytes], text: str = '') -> str:
    digest = hashlib.sha256(text.encode())
    for path, content in sources.items():
        digest.update(path.as_posix().encode() + b'\0' + content)
    return digest.hexdigest()[:LENGTH]


def _compiler() -> str:
    return f'numba {version("numba")}, {sys.implementation.cache_tag}'


def _module(path: Path) -> str:
    return '.'.join(path.with_suffix('').parts).removesuffix('.__init__')


def _is_of_ros(path: Path) -> bool:
    """Whether it is ROS code, which no kernel uses."""
    of_ros = path.name.startswith('ros_') or path.name.endswith('_node.py')
    return of_ros or path.parts[:2] == ('parallel_robot_model', 'nodes')
