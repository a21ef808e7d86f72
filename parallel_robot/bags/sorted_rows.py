"""Rows of numbers in rising order, of which all or some are read; many are kept in a file."""

from __future__ import annotations

import numpy as np

from parallel_robot.bags.kept_parts import KeptParts
from parallel_robot_model.common.units import Array


class SortedRows:
    """Rows by a time or stamp each; equal ones stay in the order in which they came.

    Attributes:
        count: How many there are.
    """

    def __init__(self, what: str) -> None:
        """Begin without any; `what` they are, for error messages."""
        self.count = 0
        self._parts = KeptParts(what)
        self._newest: float | None = None
        self._rise = True

    def add(self, times: np.ndarray, rows: Array) -> None:
        """Take the next rows, shape (N, k), with their times, shape (N,).

        Raises:
            InputError: there is no room for them.
        """
        if not len(times):
            return
        before = times[:1] if self._newest is None else self._newest
        self._rise &= bool((np.diff(times, prepend=before) >= 0).all())
        self._newest = times[-1]
        self._parts.add(times, rows)
        self.count += len(times)

    def evenly(self, most: int | None = None) -> tuple[np.ndarray, Array]:
        """At most so many of the rows from the first to the last, evenly; None: all.

        Returns:
            Rising times, shape (M,), and rows, shape (M, k).
        """
        if most is None or most >= self.count:
            wanted = np.arange(self.count)
        else:
            wanted = np.linspace(0, self.count - 1, most).astype(int)
        if not self._rise:
            wanted = np.argsort(self._times(), kind='stable')[wanted]
        order = np.argsort(wanted, kind='stable')
        begin, parts = 0, []
        for times, rows in self._parts:
            low, high = np.searchsorted(wanted[order], [begin, begin + len(times)])
            inside = wanted[order[low:high]] - begin
            parts.append((times[inside], rows[inside]))
            begin += len(times)
        there = np.argsort(order)
        found, values = (np.concatenate(each) for each in zip(*parts, strict=True))
        return found[there], values[there]

    def _times(self) -> np.ndarray:
        found, begin = np.empty(self.count, type(self._newest)), 0
        for times, _ in self._parts:
            found[begin : begin + len(times)] = times
            begin += len(times)
        return found
