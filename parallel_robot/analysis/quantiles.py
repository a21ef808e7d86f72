"""Percentiles of numbers of which there may be too many to be kept."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array

EXACT = 1 << 20  # numbers that are kept; of more, percentiles are within WIDTH / 2 of the number
WIDTH = 1e-3  # of a class, relative to its numbers
LEAST = 1e-12  # magnitude below which a number counts as zero


class Quantiles:
    """Percentiles as of :func:`numpy.percentile`: exact of up to EXACT numbers."""

    def __init__(self) -> None:
        """There are no numbers yet."""
        self._kept: list[Array] = []
        self._classes: Counter[int] = Counter()
        self._ends = (math.inf, -math.inf)
        self.count = 0

    def add(self, numbers: Array) -> None:
        """Take numbers, shape (N,)."""
        if not len(numbers):
            return
        self.count += len(numbers)
        self._ends = (
            min(self._ends[0], float(numbers.min())),
            max(self._ends[1], float(numbers.max())),
        )
        self._kept.append(numbers)
        if self.count > EXACT:
            for some in self._kept:
                self._classes.update(_counted(some))
            self._kept = []

    def at(self, percentages: Iterable[float]) -> Array:
        """The percentiles, interpolated; shape as that of the percentages."""
        asked = np.asarray([*percentages], np.float64)
        if self.count <= EXACT:
            found: Array = np.percentile(np.concatenate(self._kept), asked)
            return found
        classes = sorted(self._classes)
        ends = np.cumsum([self._classes[k] for k in classes])
        values = np.array([_middle(k) for k in classes])
        ranks = (self.count - 1) * (asked / 100.0)
        below = np.floor(ranks)
        low, high = (
            values[np.searchsorted(ends, np.minimum(each, self.count - 1), side='right')]
            for each in (below, below + 1)
        )
        between: Array = np.clip(low + (ranks - below) * (high - low), *self._ends)
        between[asked == 100.0] = self._ends[1]
        between[asked == 0.0] = self._ends[0]
        return between


def counted(counts: Counter[int], percentages: Iterable[float]) -> NDArray[np.int64]:
    """Percentiles of whole numbers that were counted, none interpolated."""
    numbers = sorted(counts)
    ends = np.cumsum([counts[number] for number in numbers])
    ranks = [max(math.ceil(ends[-1] * (asked / 100.0)), 1) for asked in percentages]
    found: NDArray[np.int64] = np.array(numbers, np.int64)[np.searchsorted(ends, ranks)]
    return found


def _counted(numbers: Array) -> dict[int, int]:
    """How many numbers are of each class."""
    sizes = np.log(np.maximum(np.abs(numbers), LEAST) / LEAST) / math.log1p(WIDTH)
    classes, counts = np.unique(
        np.sign(numbers).astype(np.int64) * (sizes.astype(np.int64) + 1), return_counts=True
    )
    return dict(zip(classes.tolist(), counts.tolist(), strict=True))


def _middle(number: int) -> float:
    """The middle of a class."""
    size = LEAST * math.exp((abs(number) - 0.5) * math.log1p(WIDTH))
    return math.copysign(size, number) if number else 0.0
