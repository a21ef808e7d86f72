"""Warnings of the parts of a bag, each kind once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from parallel_robot.bags.run import matching
from parallel_robot.bags.run.run_log import RunLog

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
        self._bag = Path()
        self._unreferenced, self._since = 0, 0.0  # states without a reference, the first one [s]

    def add(self, lines: Sequence[str]) -> None:
        """Take the lines of a part."""
        for line in lines:
            kind = self._kinds.setdefault(NUMBER.sub('0', line), _Kind(line, 0))
            kind.count += 1
            kind.same &= line == kind.first

    def take(self, bag: Path, log: RunLog) -> None:
        """Take what a window of a bag says of itself."""
        self.add(log.warnings)
        self.count(bag, log)

    def count(self, bag: Path, log: RunLog) -> None:
        """Count the states of a window that have no reference of their time."""
        known = log.referenced.all() or not np.isfinite(log.reference_position).any()
        if known or any(matching.NO_REFERENCE in line for line in log.warnings):
            return
        if not self._unreferenced:
            self._bag, self._since = bag, float(log.time[np.argmin(log.referenced)])
        self._unreferenced += int((~log.referenced).sum())

    @property
    def lines(self) -> tuple[str, ...]:
        """The first line of each kind; where others have other numbers, it says how many."""
        found = [
            kind.first if kind.same else f'{kind.first} (the first of {kind.count} such lines)'
            for kind in self._kinds.values()
        ]
        if self._unreferenced:
            text = matching.unreferenced(self._unreferenced, self._since)
            found.append(f'{self._bag}: {text}')
        return tuple(found)
