"""New files and directories: complete or not at all, and never in place of existing ones."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from parallel_robot_model.common.errors import BagError, InputError, RunError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def check(path: Path, option: str) -> None:
    """Refuse a file that exists, or whose directory does not; the message names the option.

    Raises:
        InputError: it does, or the directory does not.
    """
    if path.exists() or path.is_symlink():
        raise InputError(f'{path} exists; nothing is overwritten, choose another {option}')
    folder = path.absolute().parent
    if not folder.is_dir():
        reason = os.strerror(errno.ENOTDIR if folder.exists() else errno.ENOENT)
        raise InputError(f'cannot write {path}: {reason}')


def write(path: Path, content: bytes | memoryview) -> None:
    """Write a file that must not exist.

    Raises:
        OSError: it exists or cannot be written; with its name.
    """
    file = path.open('xb')
    try:
        with file:
            file.write(content)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from None
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def save(path: Path, content: bytes | memoryview) -> None:
    """Write the file that a command was asked for, which must not exist.

    Raises:
        InputError: it exists or cannot be written there.
        RunError: the disk is full.
    """
    with _asked_for(path):
        write(path, content)


@contextlib.contextmanager
def _asked_for(path: Path) -> Iterator[None]:
    """Say in a line why what a command was asked for cannot be written."""
    try:
        yield
    except OSError as error:
        kind = RunError if error.errno in FULL else InputError
        raise kind(f'cannot write {path}: {error.strerror}') from None


@contextlib.contextmanager
def growing(path: Path) -> Iterator[IO[bytes]]:
    """Write the file that a command was asked for, which must not exist, piece by piece.

    It is there when the block ends well; until then, a file beside it grows.

    Raises:
        InputError: it exists or cannot be written there.
        RunError: the disk is full.
    """
    with _asked_for(path):
        draft = path.with_name(f'.{path.name}.{os.getpid()}.part')
        file = draft.open('xb')
        try:
            with file:
                yield file
            _rename(draft, path)
        finally:
            draft.unlink(missing_ok=True)


def _rename(draft: Path, path: Path) -> None:
    """Give a file another name, which must not be that of a file."""
    try:
        path.hardlink_to(draft)
    except FileExistsError:
        raise
    except OSError:  # no file system knows links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
        draft.rename(path)


def save_directory(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write the directory that a command was asked for, which must not exist.

    Raises:
        InputError: it exists or cannot be written there.
        RunError: the disk is full.
    """
    with (
        _asked_for(path),
        tempfile.TemporaryDirectory(dir=path.absolute().parent) as folder,
    ):
        draft = Path(folder) / path.name
        for name, content in contents.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            write(draft / name, content)
        path.mkdir()  # none that exists, not even an empty one, is replaced
        draft.rename(path)


@contextlib.contextmanager
def written(path: Path, content: bytes) -> Iterator[None]:
    """Write a file that stays only when the block succeeds.

    Raises:
        OSError: it exists or cannot be written; with its name.
    """
    write(path, content)
    try:
        yield
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def create_directory(directory: str | Path) -> Path:
    """Make the directory of a new bag.

    Raises:
        BagError: it exists or cannot be created.
    """
    directory = Path(directory)
    check_directory(directory)
    try:
        directory.mkdir(parents=True)
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None
    return directory


def check_directory(directory: str | Path) -> None:
    """Refuse a directory that exists or cannot be made, without leaving a trace.

    Raises:
        BagError: with the reason.
    """
    directory = Path(directory)
    try:
        if directory.exists():
            raise BagError(f'{directory} exists; nothing is overwritten, choose another --out')
        parent = next(parent for parent in directory.absolute().parents if parent.exists())
        with tempfile.TemporaryDirectory(dir=parent):
            pass
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None
