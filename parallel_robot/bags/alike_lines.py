"""Warnings of the parts of a bag, each kind once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

NUMBER = re.compile(r'\d+(\.\d+)?(e[+-]?\d+)?')


@dataclass
class _Kind:
    """Lines that differ in nothing but their numbers."""

    first: str
    count: int = 1
    same: bool = True


class AlikeLines:
    """Collects lines; those that differ in nothing but their numbers count as one."""

    def __init__(self) -> None:
        """Begin without lines."""
        self._kinds: dict[str, _Kind] = {}

    def add(self, lines: Sequence[str]) -> None:
        """Take the lines of a part."""
        for line in lines:
            kind = self._kinds.setdefault(NUMBER.sub('0', line), _Kind(line, 0))
            kind.count += 1
            kind.same &= line == kind.first

    @property
    def lines(self) -> tuple[str, ...]:
        """The first line of each kind; where others have other numbers, it says how many."""
        return tuple(
            kind.first if kind.same else f'{kind.first} (the first of {kind.count} such lines)'
            for kind in self._kinds.values()
        )
