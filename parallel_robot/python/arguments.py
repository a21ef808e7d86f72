"""Arguments of the functions for Python: paths and bags."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from parallel_robot_model.common.errors import InputError


def path(what: str, given: Any) -> Path:
    """A path that is given as text or as a path.

    Args:
        what: What it is, for the error.
        given: What was given.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(given, str | Path):
        raise InputError(f'{what} must be a path, not {given!r}')
    return Path(given)


def optional(what: str, given: Any) -> Path | None:
    """A path, or None where none is given; see :func:`path`."""
    return None if given is None else path(what, given)


def bags(given: Any) -> list[Path]:
    """Paths of bags, one or several.

    Raises:
        InputError: something among them is no path, or there are none.
    """
    if isinstance(given, str | Path) or not isinstance(given, Iterable):
        return [path('a bag', given)]
    found = [path('a bag', each) for each in given]
    if not found:
        raise InputError('a bag is needed')
    return found
