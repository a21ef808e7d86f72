"""Where machine code is kept between two starts, and when it is removed.

A directory holds the machine code of exactly these sources, compiled by this Numba for this
Python, so it is never stale; all copies of the same sources share it. It carries the time of its
last use. The first start of new sources removes the versions that were not used for the longest
time. A process that is still using one of them continues with the code that it has, and compiles
what is missing.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import time
from pathlib import Path

from parallel_robot_model.processes import code_version
from parallel_robot_model.processes.user_directory import (
    MACHINE_CODE,
    is_private,
    machine_code_directories,
)

NOTICE = 'compiling; after an installation this takes about a minute, once'
KEPT = 5  # versions, this one included
KEPT_CUSTOM = 100  # versions of custom files, for each of these
UNUSED = 21 * 86400.0  # s, after which a version is removed, however few there are
ALL = 250  # approximate number of pieces of machine code after `make setup`
PREFIX = 'parallel_robot_custom_'  # prefix of the names of custom modules


def directory() -> str:
    """Directory for the machine code of these sources; empty if there can be none.

    Numba notices a change of the file of a kernel, but not of the kernels that it calls or of the
    order of the fields of a NamedTuple.
    """
    version = code_version.of_kernels()
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
            _tell_if_unused(directory)
            return str(directory)
    _tell_if_unused(Path())
    return ''


def _tell_if_unused(directory: Path) -> None:
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
            prune(root, KEPT_CUSTOM)
        os.utime(directory)
    return str(directory)


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


OWN = directory()
