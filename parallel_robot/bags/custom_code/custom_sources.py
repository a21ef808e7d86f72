"""Sources of custom modules: which files go into a bag, and under which names."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from parallel_robot.bags.limits import NAME, SOURCE, SOURCES
from parallel_robot_control.foreign import law
from parallel_robot_model.common.errors import InputError

KINDS = {  # by the key that names the files
    'custom_laws': 'law',
    'custom_robots': 'robot',
    'custom_trajectories': 'trajectory',
}

Sources = Mapping[str, Mapping[str, bytes]]  # source by key of KINDS and by name


def named(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Files of the custom modules in a configuration, or in the parameters of a node.

    Args:
        values: Key to value; what is not a list of files is left out.

    Returns:
        Key and file of each.
    """
    return [
        (key, str(path))
        for key, paths in values.items()
        if key in KINDS and isinstance(paths, list)
        for path in paths[:SOURCES]
    ]


def code(path: Path) -> bytes:
    """The source of a file of code; of a foreign law, that which stands for it."""
    return law.source_of(path) if law.is_foreign(path) else path.read_bytes()


def attachment(key: str, path: str) -> tuple[str, bytes]:
    """Name and content of the attachment of a file as it is now; the code is not run.

    Of a foreign law, the source that names it.

    Args:
        key: Key of KINDS.
        path: The file, absolute: a node may have another current directory.

    Raises:
        InputError: there is no such file, it or what a link leads to is no .py file, it cannot
            be read, or it is too large.
    """
    what = f'the {KINDS[key]} file {path}'
    try:
        if not Path(path).is_absolute() or not Path(path).exists():
            raise InputError(f'{what} is not on this machine')
        file = Path(path).resolve(strict=True)  # as it is loaded: a link has no name of its own
        if KINDS[key] == 'law' and law.is_foreign(file):
            return f'{key}/{file.stem}', law.source_of(file)
        if file.suffix != '.py' or not file.is_file():
            raise InputError(f'{what} is no .py file{"" if str(file) == path else f" but {file}"}')
        descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, 'rb') as stream:
            opened = Path(os.readlink(f'/proc/self/fd/{descriptor}'))
            if opened != file or not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise InputError(f'{what} has been replaced while it was opened')
            source = stream.read(SOURCE + 1)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f'{what} cannot be read: {error}') from None
    if len(source) > SOURCE:
        raise InputError(f'{what} has more than {SOURCE} bytes')
    return f'{key}/{file.stem}', source


def parse(attachment: str) -> tuple[str, str] | None:
    """Key and name of the custom module in an attachment; None if it is something else."""
    key, _, name = attachment.partition('/')
    good = name.isidentifier() and len(name.encode()) <= NAME
    return (key, name) if key in KINDS and good else None
