"""Noise of the sensors, from phases of a recording in which the robot rests.

Noise is told from what still moves by third differences, in which a smooth motion vanishes and
white noise has 20 times its variance.

Source:
    Hall, Kay, Titterington (1990), Asymptotically optimal difference-based estimation of variance
    in nonparametric regression, Biometrika 77(3).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.studies.identification.measured_motion import GAP, LONGEST, SPAN, STILL
from parallel_robot_model.common.tables import Part, ShownResult
from parallel_robot_model.common.units import HINGES, Array, JointUnits, rounded

SHORTEST = 0.1  # s of a phase
NONE = f'sensor noise: the bag has no phase of rest of {SHORTEST:g} s'
ORDER, GAIN = 3, 20.0  # of the differences; variance of that of white noise, in parts of its own


@dataclass(frozen=True, repr=False)
class Rest(ShownResult):
    """Noise of the measured joints at rest, rms.

    Attributes:
        duration: Length of all phases [s].
        position: [rad], shape (n,).
        velocity: [rad/s], shape (n,); NaN where it was not measured.
        units: Units of the joints.
    """

    duration: float
    position: Array
    velocity: Array
    units: JointUnits = HINGES

    def parameters(self) -> dict[str, list[float]]:
        """Parameters of the estimator that follow, by key; none where there is no noise."""
        both = {'position_noise': self.position, 'velocity_noise': self.velocity}
        return {key: rounded(values, 3) for key, values in both.items() if np.all(values > 0.0)}

    def parts(self) -> list[Part]:
        """The parameters as a scenario takes them."""
        if not self.parameters():
            return [f'no sensor noise in {self.duration:.3g} s at rest']
        head = f'sensor noise in {self.duration:.3g} s at rest, rms, for a scenario'
        found = [f'  estimator.{key}: {values}' for key, values in self.parameters().items()]
        return [head, *found]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        unknown = np.isnan(self.velocity).any()
        return {
            'duration_s': self.duration,
            self.units.key('position_noise_rad'): self.position.tolist(),
            self.units.key('velocity_noise_rad_s'): None if unknown else self.velocity.tolist(),
        }


def of(log: RunLog) -> Rest | None:
    """Noise of a run at rest; None if it has no phase of rest.

    At rest, neither the reference nor the robot moves.
    """
    steps = np.diff(log.time)
    still = Resting(float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0)
    still.add(log)
    return still.rest()


class _States(NamedTuple):
    """States that follow each other: times (N,), the others (N, n)."""

    time: Array
    position: Array
    velocity: Array
    reference_velocity: Array


class Resting:
    """Noise in the phases of rest of a run, window by window.

    Phases are cut after each LONGEST states, whatever the windows are.
    """

    def __init__(self, period: float) -> None:
        """Begin without states; `period` is the time between two [s]."""
        self._period = period
        self._left: list[_States] = []
        self._rows = self._differences = 0
        self._squares: Array | float = 0.0
        self._units = HINGES

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        self._units = log.units
        self._left.append(_States(*(getattr(log, name) for name in _States._fields)))
        states = _States(*(np.concatenate(each) for each in zip(*self._left, strict=True)))
        last = len(states.time) - len(states.time) % LONGEST
        for begin in range(0, last, LONGEST):
            self._take(_States(*(each[begin : begin + LONGEST] for each in states)))
        self._left = [_States(*(each[last:] for each in states))]

    def rest(self) -> Rest | None:
        """The noise in what was taken; None if it has no phase of rest."""
        for states in self._left:
            self._take(states)
        self._left = []
        if not self._rows:
            return None
        position, velocity = np.sqrt(self._squares / self._differences / GAIN)
        return Rest(self._rows * self._period, position, velocity, self._units)

    def _take(self, states: _States) -> None:
        time, position, velocity, reference_velocity = states
        period = self._period
        count = max(round(SHORTEST / period), 2 * ORDER) if period else 0
        if not count or len(time) <= count:
            return
        steps = np.diff(time)
        commanded = np.abs(np.nan_to_num(reference_velocity)).max(axis=1) > STILL
        span = max(1, round(SPAN / period))
        moved = np.abs(position[span:] - position[:-span]).max(axis=1) > STILL * SPAN
        moving = commanded.copy()
        for k in (0, span):  # both ends of a way
            moving[k : k + len(moved)] |= moved
        broken = (steps <= 0.0) | (steps > GAP * period)
        edges = np.flatnonzero(np.diff(moving.astype(int)) != 0) + 1
        bounds = np.unique([0, len(time), *edges, *(np.flatnonzero(broken) + 1)])
        for first, stop in itertools.pairwise(bounds.tolist()):
            if stop - first < count or moving[first]:
                continue
            self._rows += stop - first
            self._differences += stop - first - ORDER
            both = np.stack([position[first:stop], velocity[first:stop]])
            self._squares = self._squares + (np.diff(both, ORDER, axis=1) ** 2).sum(axis=1)
