"""Where the reference of a run moves, found part by part."""

from __future__ import annotations

import math

import numpy as np

STEP = 0.1  # s; what moves no longer than that is a step, of which the response is looked at
FEW = 0.01  # share of samples at which a reference of steps moves at most


class ReferenceMoves:
    """Where the reference of a run moves, part by part.

    Attributes:
        rows: Number of its samples.
    """

    def __init__(self, end: float = math.inf) -> None:
        """Begin; `end`: time up to which the run is looked at [s]."""
        self.rows = 0
        self._end = np.nextafter(end, math.inf)
        self._before = np.empty((0, 0))  # the last row
        self._last_time = math.nan
        self._count = 0
        self._first = self._after = 0  # samples: before the first move, after the last one
        self._first_time = self._after_time = math.nan

    def add(self, time: np.ndarray, reference: np.ndarray) -> None:
        """Take the next part: times [s], shape (N,), desired positions [rad], shape (N, n)."""
        count = int(np.searchsorted(time, self._end))
        if not count:
            return
        time, known = time[:count], reference[:count]
        if self.rows:
            known = np.vstack([self._before, known])
        moves = np.flatnonzero(np.diff(known, axis=0).any(axis=1))
        if moves.size:
            back = len(known) - count
            times = np.concatenate([np.full(back, self._last_time), time])
            if not self._count:
                self._first = self.rows - back + int(moves[0])
                self._first_time = float(times[moves[0]])
            self._after = self.rows - back + int(moves[-1]) + 1
            self._after_time = float(times[moves[-1] + 1])
            self._count += moves.size
        self._before, self._last_time = known[-1:], float(time[-1])
        self.rows += count

    @property
    def first(self) -> int:
        """Sample from which on it moves; 0 where it does not."""
        return self._first if self._moves else 0

    @property
    def last(self) -> int:
        """The sample after its last move."""
        return self._after

    @property
    def rest(self) -> float | None:
        """Time from which on it rests to the end [s]; None where it moves on."""
        return self._after_time if self._moves and self._after + 1 < self.rows else None

    @property
    def _moves(self) -> bool:
        """Whether it does, but for steps."""
        lasts, samples = self._after_time - self._first_time, self._after - self._first
        return bool(self._count) and not (lasts < STEP or self._count < FEW * samples)
