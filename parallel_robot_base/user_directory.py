"""A directory of the suite that belongs to this user alone."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


def user_directories() -> Iterator[Path]:
    """Directories that are the user's own and exist: in the cache, then a temporary one.

    One that belongs to another user, or is reached by another user's link, is left out.
    """
    cache = Path(os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache'))
    for found in (
        cache / 'parallel_robot',
        Path(tempfile.gettempdir()) / f'parallel_robot_{os.getuid()}',
    ):
        with contextlib.suppress(OSError):
            found.mkdir(mode=0o700, parents=True, exist_ok=True)
            if {found.lstat().st_uid, found.stat().st_uid} == {os.getuid()}:
                yield found
