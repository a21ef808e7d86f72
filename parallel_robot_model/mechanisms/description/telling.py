"""Names of parts of a robot in messages."""

from __future__ import annotations

from collections.abc import Iterable

from parallel_robot_model.common.errors import printable

FEW = 8  # names that a message lists


def listed(names: Iterable[str]) -> str:
    """The first names, and how many more there are."""
    found = list(names)
    more = f' and {len(found) - FEW} more' if len(found) > FEW else ''
    return ', '.join(map(printable, found[:FEW])) + more
