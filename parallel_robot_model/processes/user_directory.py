"""Directories of the suite that belong to this user alone, and files in them."""

from __future__ import annotations

import contextlib
import grp
import os
import pwd
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from parallel_robot_model.common.errors import RunError

CACHE, STATE = 'XDG_CACHE_HOME', 'XDG_STATE_HOME'  # variables of the environment
MACHINE_CODE = 'NUMBA_CACHE_DIR'  # likewise
# Who owns what lies above; NOBODY in a container stands for any other user.
ROOT, NOBODY = 0, 65534


def user_directories() -> Iterator[Path]:
    """Directories that are the user's own and exist: in CACHE, then a temporary one.

    One that belongs to another user, is reached by another user's link, or can be written by
    others is left out.
    """
    return _private_directories(CACHE, '~/.cache')


def machine_code_directories() -> Iterator[Path]:
    """The same for machine code: in MACHINE_CODE, where that is set, else in CACHE."""
    return _private_directories(MACHINE_CODE, os.environ.get(CACHE) or '~/.cache')


def state_directories() -> Iterator[Path]:
    """The same for what must outlive an emptied cache: in STATE, then a temporary one."""
    return _private_directories(STATE, '~/.local/state')


def _private_directories(variable: str, usual: str) -> Iterator[Path]:
    chosen = os.environ.get(variable)
    given = os.path.abspath(chosen) if chosen else os.path.expanduser(usual)
    places = [Path(given) / 'parallel_robot'] if os.path.isabs(given) else []  # there is a home
    with contextlib.suppress(FileNotFoundError):  # there is no temporary directory
        places.append(Path(tempfile.gettempdir()) / f'parallel_robot_{os.getuid()}')
    for place in places:
        with contextlib.suppress(OSError):
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            if {place.lstat().st_uid, place.stat().st_uid} == {os.getuid()} and is_private(place):
                yield place


def is_private(directory: str | Path) -> bool:
    """Whether no other user can write into a directory, or put another one in its place.

    Args:
        directory: It exists.
    """
    resolved = Path(directory).resolve()
    if not _is_ours(resolved.stat()):
        return False
    for above in map(Path.stat, resolved.parents):
        sticky = above.st_mode & stat.S_ISVTX  # as /tmp: others cannot rename what is there
        if above.st_uid not in (os.getuid(), ROOT, NOBODY) or not (sticky or _is_closed(above)):
            return False
    return True


def _is_ours(status: os.stat_result) -> bool:
    return status.st_uid in (os.getuid(), ROOT) and _is_closed(status)


def _is_closed(status: os.stat_result) -> bool:
    """Whether only the owner can write; a group of the user's name has no other members."""
    if status.st_mode & stat.S_IWOTH:
        return False
    if not status.st_mode & stat.S_IWGRP or status.st_gid == ROOT:
        return True
    try:
        group = grp.getgrgid(status.st_gid)
        return not group.gr_mem and group.gr_name == pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return False


def open_private(name: str, directories: Iterator[Path], variable: str) -> IO[bytes]:
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
        if is_private_file(os.fstat(descriptor)):
            return os.fdopen(descriptor, 'r+b')
        os.close(descriptor)
        reason = f'{root / name} is not a file of yours; remove it'
    raise RunError(reason)


def is_private_file(status: os.stat_result) -> bool:
    """Whether this is a regular file of the user's."""
    return stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid()


# An emergency stop outlives the controller that received it: it is saved in a file.


class StopRecord:
    """The file that says that a controller is in emergency stop; its time says since when."""

    def __init__(self, node: str) -> None:
        """Name it after the ROS domain and a node by its full name."""
        domain = os.environ.get('ROS_DOMAIN_ID') or '0'
        self._name = f'stopped_{domain}{node.replace("/", ".")}'  # no name of ROS has dots

    def save(self) -> str:
        """Save a stop that was requested just now; returns why that failed, or nothing."""
        try:
            with open_private(self._name, state_directories(), STATE) as file:
                os.utime(file.fileno())
        except (RunError, OSError) as error:
            return str(error)
        return ''

    def stopped_at(self) -> float | None:
        """When the stop was requested, in seconds since 1970; None when there is none."""
        times = [status.st_mtime for _, status in self._files()]
        return max(times, default=None)

    def forget(self) -> str:
        """Remove the saved stop; returns why that failed, or nothing."""
        reason = ''
        for path, _ in self._files():
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                reason = f'cannot remove {path}: {error.strerror}'
        return reason

    def _files(self) -> list[tuple[Path, os.stat_result]]:
        """The user's own files of this name; what else may lie there is not looked at."""
        files = []
        for root in state_directories():
            with contextlib.suppress(OSError):
                status = os.lstat(root / self._name)
                if is_private_file(status):
                    files.append((root / self._name, status))
        return files
