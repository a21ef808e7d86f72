"""Where machine code is cached between two starts, and when it is removed.

A directory holds the machine code of exactly these sources, compiled by this Numba for this
Python, so it is never stale; all copies of the same sources share it. It carries the time of its
last use. The first start of new sources removes the versions that were not used for the longest
time. A process that is still using one of them continues with the code that it has, and compiles
what is missing.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import re
import shutil
import sys
import time
from importlib.metadata import version
from pathlib import Path

from parallel_robot_model.processes.user_directory import (
    MACHINE_CODE,
    is_private,
    machine_code_directories,
)

# Which code this is: a hash of all sources of the suite, and one of those of machine code.

KERNEL_MARKS = (
    b'@kernel', b'@inner', b'@inlined', b'numba.extending', b'@lower_builtin', b'@in_kernels',
    b'@on_vectors',
)  # fmt: skip
TUPLES = b'(NamedTuple)'  # machine code addresses their members by position
NUMBA_SETTINGS = (  # of Numba, in the environment: they change the machine code of the same source
    'NUMBA_OPT', 'NUMBA_BOUNDSCHECK', 'NUMBA_DEBUGINFO', 'NUMBA_ENABLE_AVX',
    'NUMBA_LOOP_VECTORIZE', 'NUMBA_SLP_VECTORIZE',
)  # fmt: skip
PACKAGE = re.compile('parallel_robot(_[a-z]+)?|trajectory_gen')  # packages of the suite
FROM = re.compile(rb'^from ([\w.]+) import (\([^)]*\)|[^\n]*)', re.MULTILINE)
NAME = re.compile(r'\w+')
HASH_LENGTH = 16  # characters of a hash


def suite_root() -> Path:
    """Directory with the packages of the suite."""
    return Path(__file__).resolve().parents[2]


def is_source(file: Path) -> bool:
    """Whether a file (absolute path) belongs to the suite."""
    return file.is_relative_to(suite_root()) and bool(
        PACKAGE.fullmatch(file.relative_to(suite_root()).parts[0])
    )


@functools.cache
def suite_hash() -> str:
    """All of it: Python sources of the suite, and what compiles them; not where it lies."""
    digest = _digest(_sources())
    return f'{digest}, {_compiler()}'


def kernels_hash() -> str:
    """What machine code depends on, and what compiles it.

    These are the files with kernels and those that they import, for a constant of them is a part
    of the machine code; and all files with classes of tuples, which kernels take.
    """
    sources = {path: text for path, text in _sources().items() if not _is_of_ros(path)}
    names = {path[:-3].removesuffix('/__init__').replace('/', '.'): path for path in sources}
    waiting = [
        path for path, text in sources.items() if any(mark in text for mark in KERNEL_MARKS)
    ]
    chosen = {*waiting, *(path for path, text in sources.items() if TUPLES in text)}
    while waiting:
        for package, imported in FROM.findall(sources[waiting.pop()]):
            base = package.decode()
            for name in ('', *NAME.findall(imported.decode())):
                path = names.get(f'{base}.{name}' if name else base)
                if path is not None and path not in chosen:
                    waiting.append(path)
                    chosen.add(path)
    settings = [f'{name}={os.environ[name]}' for name in NUMBA_SETTINGS if name in os.environ]
    text = ' '.join([_compiler(), *settings])
    return _digest({path: sources[path] for path in sorted(chosen)}, text)


def _sources() -> dict[str, bytes]:
    """Content of the Python sources of the suite, by path below the root; at each start."""
    base = f'{suite_root()}/'
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
    return digest.hexdigest()[:HASH_LENGTH]


def _compiler() -> str:
    return f'numba {version("numba")}, {sys.implementation.cache_tag}'


def _is_of_ros(path: str) -> bool:
    """Whether it is ROS code, which no kernel uses."""
    name = path.rpartition('/')[2]
    of_nodes = path.startswith('parallel_robot_model/nodes/')
    return of_nodes or name.startswith('ros_') or name.endswith('_node.py')


NOTICE = 'compiling; after an installation this takes about a minute, once'
MAX_VERSIONS = 5  # versions, this one included
MAX_CUSTOM_VERSIONS = 100  # versions of custom files, for each of these
UNUSED = 21 * 86400.0  # s, after which a version is removed, however few there are
ALL = 250  # approximate number of pieces of machine code after `make setup`
PREFIX = 'parallel_robot_custom_'  # prefix of the names of custom modules


def directory() -> str:
    """Directory for the machine code of these sources; empty if there can be none.

    Numba notices a change of the file of a kernel, but not of the kernels that it calls or of the
    order of the fields of a NamedTuple.
    """
    version = kernels_hash()
    for root in machine_code_directories():
        directory = root / f'kernels_{version}'
        try:
            new = not directory.exists()
            directory.mkdir(exist_ok=True)
            os.utime(directory)
            private = is_private(directory)
        except OSError:
            continue
        if private and os.access(directory, os.W_OK):
            if new:
                prune(root)
            _warn_if_unused(directory)
            return str(directory)
    _warn_if_unused(Path())
    return ''


def _warn_if_unused(directory: Path) -> None:
    """Say that machine code does not lie where the user wants it."""
    chosen = os.environ.get(MACHINE_CODE)
    if chosen and not directory.is_relative_to(os.path.abspath(chosen)):
        logging.getLogger('parallel_robot').warning(
            f'{MACHINE_CODE}: {chosen} is not used, for you cannot write there, or others can'
        )


def marked(name: str) -> str | None:
    """What :func:`mark` noted about the kernels in the directory; None if nothing."""
    with contextlib.suppress(OSError):
        if OWN:
            return (Path(OWN) / name).read_text()
    return None


def mark(name: str, text: str = '') -> None:
    """Note something about the kernels in the directory, for as long as they are kept."""
    with contextlib.suppress(OSError):
        if OWN:
            (Path(OWN) / name).write_text(text)


def subdirectory(name: str) -> str:
    """Directory for other machine code of the same sources; empty if there can be none."""
    return str(Path(OWN) / name) if OWN else ''


def custom(name: str) -> str:
    """Directory for machine code that depends on a custom module; its name has its hash."""
    root = Path(OWN) / 'custom'
    directory = root / name
    with contextlib.suppress(OSError):
        if not directory.exists():
            directory.mkdir(parents=True)
            prune(root, MAX_CUSTOM_VERSIONS)
        os.utime(directory)
    return str(directory)


def compiled() -> str:
    """How far the machine code of the suite is compiled; empty where that cannot be known."""
    if not OWN:
        return ''
    done = sum(1 for _ in Path(OWN).rglob('*.nbc'))
    return f'{min(done, ALL)} of about {ALL} kernels are compiled'


def prune(root: Path, count: int = MAX_VERSIONS) -> None:
    """Remove the machine code that will hardly be used again: all but the newest directories."""
    times: dict[Path, float] = {}
    for path in root.iterdir():
        with contextlib.suppress(OSError):  # another process may be removing it, too
            if path.is_dir():
                times[path] = path.stat().st_mtime
    newest_first = sorted(times, key=times.__getitem__, reverse=True)
    old = {path for path, used in times.items() if time.time() - used > UNUSED}
    for path in old.union(newest_first[count:]):
        shutil.rmtree(path, ignore_errors=True)


OWN = directory()
