"""Where machine code is kept between two starts, how it is found quickly, and when it goes.

A directory of its own holds the code of exactly these sources in exactly this place, so it is
never stale. It carries the time of its last use; the first start of new sources removes others:
of the same place all but the newest few, of other places what nobody has used for some weeks. A
process that is still using one of them goes on with the code that it has, and compiles what it has
not.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import shutil
import time
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, NullCache
from numba.core.runtime import rtsys

from parallel_robot_model.user_directory import user_directories

COMPLETE = 'complete'  # file that says that all kernels of the suite have been compiled
KEPT = 3  # versions of the same place, this one included
UNUSED = 21 * 86400.0  # s, after which the code of any place is removed
NOTICE = 'compiling; after an installation this takes about a minute, once'
ALL = 119  # pieces of machine code that `make setup` leaves, about
AGAIN = 10.0  # s, between two lines that say how far it is


def directory() -> str:
    """Directory for the machine code of exactly these sources; empty if there can be none.

    Numba notices a change of the file of a kernel, but not of the kernels that it calls or of the
    order of the fields of a NamedTuple.
    """
    packages = Path(__file__).resolve().parents[1]
    place = hashlib.sha256(bytes(packages)).hexdigest()[:8]
    for root in user_directories():
        found = root / f'{place}_{_version(packages)}'
        try:
            new = not found.exists()
            found.mkdir(exist_ok=True)
            os.utime(found)
        except OSError:
            continue
        if os.access(found, os.W_OK):
            if new:
                prune(root, place)
            return str(found)
    return ''


def marked(name: str) -> str | None:
    """What was noted of the kernels in the directory; None when nothing was."""
    with contextlib.suppress(OSError):
        if _OWN:
            return (Path(_OWN) / name).read_text()
    return None


def mark(name: str, text: str = '') -> None:
    """Note something of the kernels in the directory, for as long as they are kept."""
    with contextlib.suppress(OSError):
        if _OWN:
            (Path(_OWN) / name).write_text(text)


def subdirectory(name: str) -> str:
    """Directory for other machine code of the same sources; empty if there can be none."""
    return str(Path(_OWN) / name) if _OWN else ''


def compiled() -> str:
    """How far the machine code of the suite is compiled; empty where nobody knows."""
    if not _OWN:
        return ''
    done = sum(1 for _ in Path(_OWN).rglob('*.nbc'))
    return f'{min(done, ALL)} of about {ALL} kernels are compiled'


def prune(root: Path, place: str) -> None:
    """Remove the machine code that will hardly be used again."""
    times: dict[Path, float] = {}
    for path in root.iterdir():
        with contextlib.suppress(OSError):  # another process removes it, too
            times[path] = path.stat().st_mtime
    versions = sorted(
        (path for path in times if path.name.startswith(place)), key=times.__getitem__
    )
    old = {path for path, used in times.items() if time.time() - used > UNUSED}
    for path in old.union(versions[:-KEPT]):
        shutil.rmtree(path, ignore_errors=True)


def _version(packages: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(
        [*packages.glob('parallel_robot_*/**/*.py'), *packages.glob('trajectory_gen/*.py')]
    ):
        if path.name.startswith('ros_') or path.name.endswith('_node.py'):
            continue  # of ROS, which no kernel knows
        content = path.read_bytes()
        if any(mark in content for mark in (b'@kernel', b'@inner', b'@inlined', b'(NamedTuple)')):
            digest.update(content)
    return digest.hexdigest()[:16]


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The cache of one kernel: it says when it does not have it."""

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Load the machine code for a signature; None where there is none that can be read.

        Numba would first prepare to compile, which takes a third of a second; the compiler does so
        itself. What is loaded needs the run time alone.
        """

        def initialise() -> None:
            del context.refresh  # for whoever compiles
            rtsys.initialize(context)

        context.refresh = initialise
        found = None
        try:
            with contextlib.suppress(OSError):
                found = super().load_overload(signature, context)
        finally:
            vars(context).pop('refresh', None)
        if found is None:
            _announce()
        return found

    def save_overload(self, signature: Any, data: Any) -> None:
        """Save machine code, if there is a place for it: a full disk stops nobody."""
        with contextlib.suppress(OSError):
            super().save_overload(signature, data)
            _report()


class NoCache(NullCache):  # type: ignore[misc]
    """The cache of a kernel that is compiled at every start."""

    def load_overload(self, signature: Any, context: Any) -> None:
        """Say that there is none."""
        _announce()


@functools.cache
def _announce() -> None:
    """Tell that something is compiled, once."""
    logging.getLogger('parallel_robot').info(NOTICE)


def _report() -> None:
    """Tell now and then how far it is."""
    global _due
    if time.monotonic() >= _due:
        _due = time.monotonic() + AGAIN
        if compiled():
            logging.getLogger('parallel_robot').info(compiled())


_due = time.monotonic() + AGAIN


# Not what Numba has read from a .numba_config.yaml in the current directory, where anybody may
# have put it: the files of a cache are run.
_OWN = '' if os.environ.get('NUMBA_CACHE_DIR') else directory()
numba.config.CACHE_DIR = os.environ.get('NUMBA_CACHE_DIR') or _OWN
