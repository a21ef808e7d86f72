"""Files that are written complete or not at all, and never in the place of others."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from parallel_robot_base.errors import InputError


def check(path: Path, option: str) -> None:
    """Refuse a file that exists; `option` chooses another.

    Raises:
        InputError: it does.
    """
    if path.exists() or path.is_symlink():
        raise InputError(f'{path} exists; nothing is overwritten, choose another {option}')


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
