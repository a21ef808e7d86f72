"""Fewer points of a curve, with all its spikes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

MOST = 100_000  # values of a curve that grows
INTERVALS = 1500  # of a curve; two points of each are finer than the dots of a page


def extremes(
    values: np.ndarray, intervals: int = INTERVALS, times: np.ndarray | None = None
) -> np.ndarray:
    """Choose the smallest and the largest value in each of equal intervals.

    Args:
        values: A curve, shape (N,).
        intervals: Number of intervals.
        times: Of the values, in rising order, shape (N,); None: at equal distances.

    Returns:
        Indices in rising order, a pair for each interval that has a value; all N if they are not
        more than two for each.
    """
    if len(values) <= 2 * intervals:
        return np.arange(len(values))
    bounds = np.linspace(0, len(values), intervals + 1).astype(int)
    if times is not None:
        bounds[1:-1] = np.searchsorted(
            times, np.linspace(times[0], times[-1], intervals + 1)[1:-1]
        )
    pairs = [
        (start + np.argmin(values[start:end]), start + np.argmax(values[start:end]))
        for start, end in pairwise(bounds)
        if start < end
    ]
    return np.sort(np.array(pairs), axis=1).ravel()


class Curves:
    """Curves that grow; of long ones, what can be seen.

    Attributes:
        time: Of the values that are kept [s], shape (N,).
        values: Of each curve, shape (N, c).
    """

    def __init__(self) -> None:
        """Begin without values."""
        self.time = np.zeros(0)
        self.values = np.zeros((0, 0))

    def add(self, time: np.ndarray, values: np.ndarray) -> None:
        """Append values; `time` as of :attr:`time`, `values` as of :attr:`values`."""
        if len(self.time):
            time, values = np.append(self.time, time), np.vstack([self.values, values])
        if len(time) > MOST:
            kept = [extremes(column, times=time) for column in np.nan_to_num(values).T]
            rows = np.unique(np.concatenate([*kept, [0, len(time) - 1]]))
            time, values = time[rows], values[rows]
        self.time, self.values = time, values


def envelope(values: np.ndarray) -> np.ndarray:
    """Largest magnitude in each pair of neighbours, for both, shape (N,).

    For a decimated curve it is that of the interval, without dips where the curve crosses zero.
    """
    even = len(values) - len(values) % 2
    pairs = np.abs(values[:even]).reshape(-1, 2).max(axis=1)
    return np.concatenate([np.repeat(pairs, 2), np.abs(values[even:])])
