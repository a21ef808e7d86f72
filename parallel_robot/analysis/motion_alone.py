"""What is known of a motion for which the bag has no reference."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parallel_robot.analysis.timing import Quantiles
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.tables import Part, Table


class MotionAlone:
    """Tells what is known of a motion that comes in windows."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._log: RunLog | None = None
        self._ends = math.nan, math.nan
        self._steps = Quantiles()
        self._count = 0
        self._rows: dict[str, np.ndarray] = {}
        self._measured = True, True

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        if not len(log.time):
            return
        time, first = log.time, self._log is None
        self._steps.add(np.diff(time) if first else np.diff(time, prepend=self._ends[1]))
        self._ends = float(time[0]) if first else self._ends[0], float(time[-1])
        self._log, self._count = log, self._count + len(time)
        speeds, torques = self._measured
        self._measured = speeds and log.has_velocities, torques and log.has_efforts
        rows = {
            'low': log.position.min(axis=0),
            'high': log.position.max(axis=0),
            'velocity': np.sum(log.velocity**2, axis=0),
            'torque': np.sum(log.effort**2, axis=0),
            'largest': np.abs(log.effort).max(axis=0),
        }
        joined = {'low': np.minimum, 'high': np.maximum, 'largest': np.maximum}
        self._rows = {
            name: values if first else joined.get(name, np.add)(self._rows[name], values)
            for name, values in rows.items()
        }

    def parts(self) -> list[Part]:
        """Length, rate, and for each joint span, speed and torque."""
        log, (begin, end) = self._taken, self._ends
        head = f'{self._count} states in {end - begin:g} s, one in {1e3 * self._period:.4g} ms'
        rows = [[name, *(f'{value:.4f}' for value in row)] for name, row in self._of().items()]
        return [
            f'{log.scenario}, {head}: no reference, so no errors',
            Table(['', *log.joints], rows),
        ]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        log, (begin, end) = self._taken, self._ends
        joints = {
            name: dict(zip(log.joints, map(float, row), strict=True))
            for name, row in self._of().items()
        }
        return {
            'scenario': log.scenario,
            'states': self._count,
            'duration_s': end - begin,
            'period_s': self._period,
            'joints': joints,
        }

    @property
    def _taken(self) -> RunLog:
        assert self._log is not None
        return self._log

    @property
    def _period(self) -> float:
        """Median time between two states [s]."""
        return float(self._steps.at([50])[0]) if self._count > 1 else math.nan

    def _of(self) -> dict[str, np.ndarray]:
        """Figures of each joint by name with unit, shape (n,)."""
        found, (speeds, torques) = self._rows, self._measured
        units = self._taken.units
        what = 'position' if any(units.slides) else 'angle'
        rows = {f'lowest {what} [rad]': found['low'], f'highest {what} [rad]': found['high']}
        if speeds:
            rows['velocity, rms [rad/s]'] = np.sqrt(found['velocity'] / self._count)
        if torques:
            rows['torque, rms [N m]'] = np.sqrt(found['torque'] / self._count)
            rows['torque, max [N m]'] = found['largest']
        return {units.label(name): numbers for name, numbers in rows.items()}
