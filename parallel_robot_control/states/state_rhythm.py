"""How often joint states come, and how many of them were not answered, by their stamps."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import NANOSECONDS, Array, usual_step
from parallel_robot_model.configuration.loop import MICROSECOND

FEW = 10  # steps from a state to the next, below which nothing is said
NEAR = 0.1  # share of the period, by which steps may differ from it on average
SINGLE = 0.02  # share of steps of one period, at least, of states of that period
PAUSE = NANOSECONDS // 2  # ns; a longer step is one to another run


class StateRhythm:
    """Finds the period of the states that were answered, and how many are missing between them.

    Attributes:
        period: From a state to the next [ns]: that of the configuration while it fits.
        skipped: Number of states that were not answered, or never arrived.
    """

    def __init__(self, period: int) -> None:
        """Prepare; `period` is that of the configuration [ns]."""
        self.period = self._told = period
        self.skipped = 0
        self._noted: deque[NDArray[np.int64]] = deque()
        self._stamps = np.zeros(0, np.int64)

    def note(self, stamps: NDArray[np.int64]) -> None:
        """Note the stamps of answered states [ns], zero for none; cheap, for the loop."""
        self._noted.append(stamps)

    def look(self) -> None:
        """Take in what was noted since the last time; in one thread alone."""
        new = [self._noted.popleft() for _ in range(len(self._noted))]
        stamps = np.concatenate([self._stamps, *(part[part > 0] for part in new)])
        if len(stamps) <= FEW:
            self._stamps = stamps
            return
        self._stamps = stamps[-1:]
        steps = np.diff(stamps)
        steps = steps[(steps > 0) & (steps < PAUSE)]
        if not len(steps):
            return
        periods = _periods(steps, self._told)
        near = abs(steps.sum() / (periods.sum() * self._told) - 1.0) < NEAR
        fits = near and np.mean(periods == 1) > SINGLE
        self.period = self._told if fits else _whole(usual_step(steps))
        # Each by itself counts steps that are long by chance, all together a period that is.
        missing = min(_periods(steps, self.period).sum(), round(steps.sum() / self.period))
        self.skipped += max(0, int(missing) - len(steps))

    @property
    def doubt(self) -> str:
        """That the period of the configuration is another one; empty if it fits."""
        if self.period == self._told:
            return ''
        come, told = (NANOSECONDS / each for each in (self.period, self._told))
        return (
            f'joint states come at {come:.4g} Hz, the period says {told:.4g} Hz: '
            f'give the controller the period {self.period / NANOSECONDS:.4g}'
        )


def _whole(period: float) -> int:
    """A period in whole microseconds [ns], as a configuration has it."""
    return max(1, round(period / MICROSECOND)) * MICROSECOND


def _periods(steps: NDArray[np.int64], period: int) -> Array:
    """Number of periods of each step."""
    return np.maximum(np.rint(steps / period), 1.0)
