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
from typing import Any

import numpy as np

from parallel_robot.bags.run_log import RunLog
from parallel_robot.studies.identification.measured_motion import GAP, SPAN, STILL
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.shown_result import ShownResult
from parallel_robot_model.common.tables import Part
from parallel_robot_model.common.units import HINGES, JointUnits

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
        return {
            key: [float(f'{value:.3g}') for value in values]
            for key, values in both.items()
            if np.all(values > 0.0)
        }

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
    time = log.time
    if len(time) < 2:
        return None
    steps = np.diff(time)
    period = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    count = max(round(SHORTEST / period), 2 * ORDER) if period else 0
    if not count or len(time) <= count:
        return None
    commanded = np.abs(np.nan_to_num(log.reference_velocity)).max(axis=1) > STILL
    span = max(1, round(SPAN / period))
    moved = np.abs(log.position[span:] - log.position[:-span]).max(axis=1) > STILL * SPAN
    moving = commanded.copy()
    for k in (0, span):  # both ends of a way
        moving[k : k + len(moved)] |= moved
    broken = (steps <= 0.0) | (steps > GAP * period)
    edges = np.flatnonzero(np.diff(moving.astype(int)) != 0) + 1
    bounds = np.unique([0, len(time), *edges, *(np.flatnonzero(broken) + 1)])
    phases = [
        slice(first, stop)
        for first, stop in itertools.pairwise(bounds.tolist())
        if stop - first >= count and not moving[first]
    ]
    if not phases:
        return None
    rows = sum(phase.stop - phase.start for phase in phases)
    position, velocity = (
        _noise([values[phase] for phase in phases]) for values in (log.position, log.velocity)
    )
    return Rest(rows * period, position, velocity, log.units)


def _noise(parts: list[Array]) -> Array:
    """Standard deviation of white noise in several stretches, each shape (N, n)."""
    differences = np.concatenate([np.diff(part, ORDER, axis=0) for part in parts])
    return np.sqrt(np.mean(differences**2, axis=0) / GAIN)
