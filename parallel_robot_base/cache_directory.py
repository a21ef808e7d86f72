"""Where machine code is kept between two starts, and when it is removed.

A directory holds the machine code of exactly these sources, compiled by this Numba for this
Python, so it is never stale; all copies of the same sources share it. It carries the time of its
last use. The first start of new sources removes the versions that were not used for the longest
time. A process that is still using one of them continues with the code that it has, and compiles
what is missing.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import sys
import time
from importlib.metadata import version
from pathlib import Path

from parallel_robot_base.user_directory import is_private, user_directories

NOTICE = 'compiling; after an installation this takes about a minute, once'
COMPLETE = 'complete'  # file that says that all kernels of the suite have been compiled
KEPT = 5  # versions, this one included
KEPT_CUSTOM = 100  # versions of custom files, for each of these
UNUSED = 21 * 86400.0  # s, after which a version is removed, however few there are
ALL = 270  # approximate number of pieces of machine code after `make setup`
SOURCES = (  # what kernels are made of
    b'@kernel', b'@inner', b'@inlined', b'(NamedTuple)', b'numba.extending', b'@lower_builtin',
)  # fmt: skip
PREFIX = 'parallel_robot_custom_'  # prefix of the names of custom modules
ROOM = re.compile('parallel_robot_[a-z]+|trajectory_gen')  # packages of the suite


def directory() -> str:
    """Directory for the machine code of these sources; empty if there can be none.

    Numba notices a change of the file of a kernel, but not of the kernels that it calls or of the
    order of the fields of a NamedTuple.
    """
    version = _version()
    for root in user_directories():
        found = root / f'kernels_{version}'
        try:
            new = not found.exists()
            found.mkdir(exist_ok=True)
            os.utime(found)
            private = is_private(found)
        except OSError:
            continue
        if private and os.access(found, os.W_OK):
            if new:
                prune(root)
            return str(found)
    return ''


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
    root = Path(OWN or os.environ['NUMBA_CACHE_DIR']) / 'custom'
    found = root / name
    with contextlib.suppress(OSError):
        if not found.exists():
            found.mkdir(parents=True)
            prune(root, KEPT_CUSTOM)
        os.utime(found)
    return str(found)


def compiled() -> str:
    """How far the machine code of the suite is compiled; empty where that cannot be known."""
    if not OWN:
        return ''
    done = sum(1 for _ in Path(OWN).rglob('*.nbc'))
    return f'{min(done, ALL)} of about {ALL} kernels are compiled'


def prune(root: Path, kept: int = KEPT) -> None:
    """Remove the machine code that will hardly be used again: all but the newest directories."""
    times: dict[Path, float] = {}
    for path in root.iterdir():
        with contextlib.suppress(OSError):  # another process may be removing it, too
            if path.is_dir():
                times[path] = path.stat().st_mtime
    newest_first = sorted(times, key=times.__getitem__, reverse=True)
    old = {path for path, used in times.items() if time.time() - used > UNUSED}
    for path in old.union(newest_first[kept:]):
        shutil.rmtree(path, ignore_errors=True)


def is_source(file: Path) -> bool:
    """Whether a file (absolute path) belongs to the suite."""
    root = _root()
    return file.is_relative_to(root) and bool(ROOM.fullmatch(file.relative_to(root).parts[0]))


def _root() -> Path:
    return Path(__file__).resolve().parents[1]


def _version() -> str:
    """Hash of the sources that the machine code depends on, and of what compiles them."""
    digest = hashlib.sha256(f'{version("numba")} {sys.implementation.cache_tag}'.encode())
    root = _root()
    rooms = [
        path
        for path in root.iterdir()
        if ROOM.fullmatch(path.name) and path.name != 'parallel_robot_ros'
    ]
    for path in sorted(path for room in rooms for path in room.rglob('*.py')):
        if path.name.startswith('ros_') or path.name.endswith('_node.py'):
            continue  # ROS code, which no kernel uses
        content = path.read_bytes()
        if any(mark in content for mark in SOURCES):
            digest.update(path.relative_to(root).as_posix().encode() + b'\0' + content)
    return digest.hexdigest()[:16]


OWN = '' if os.environ.get('NUMBA_CACHE_DIR') else directory()
