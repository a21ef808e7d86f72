"""Directories of the suite that belong to this user alone, and files in them."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from parallel_robot_base.errors import RunError

CACHE, STATE = 'XDG_CACHE_HOME', 'XDG_STATE_HOME'  # variables of the environment


def user_directories() -> Iterator[Path]:
    """Directories that are the user's own and exist: in CACHE, then a temporary one.

    One that belongs to another user, or is reached by another user's link, is left out.
    """
    return _own_directories(CACHE, '~/.cache')


def state_directories() -> Iterator[Path]:
    """The same for what must outlive an emptied cache: in STATE, then a temporary one."""
    return _own_directories(STATE, '~/.local/state')


def _own_directories(variable: str, usual: str) -> Iterator[Path]:
    given = Path(os.environ.get(variable) or os.path.expanduser(usual))
    for found in (
        given / 'parallel_robot',
        Path(tempfile.gettempdir()) / f'parallel_robot_{os.getuid()}',
    ):
        with contextlib.suppress(OSError):
            found.mkdir(mode=0o700, parents=True, exist_ok=True)
            if {found.lstat().st_uid, found.stat().st_uid} == {os.getuid()}:
                yield found


def open_own(name: str, directories: Iterator[Path], variable: str) -> IO[bytes]:
    """Open a regular file in the first of some directories of the user's own that has place.

    Nothing else of that name is opened.

    Args:
        name: Of the file.
        directories: The directories.
        variable: What names the first of them in the environment.

    Raises:
        RunError: no directory has place for it.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    reason = f'no directory of your own for {name}; set {variable} to one'
    for root in directories:
        try:
            descriptor = os.open(root / name, flags, 0o600)
        except OSError as error:
            reason = f'cannot open {root / name}: {error.strerror}'
            continue
        if is_own(os.fstat(descriptor)):
            return os.fdopen(descriptor, 'r+b')
        os.close(descriptor)
        reason = f'{root / name} is not a file of yours; remove it'
    raise RunError(reason)


def is_own(status: os.stat_result) -> bool:
    """Whether this is a regular file of the user's."""
    return stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid()
