"""The results of a run, of a motion alone, or of a simulation in parts: plain data and tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis import metrics, timing
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.readable_metrics import as_data, head, whole
from parallel_robot.analysis.thinned import Curves, Series
from parallel_robot.analysis.timing import Quantiles
from parallel_robot.bags.columns import MotionColumns
from parallel_robot.bags.messages.message_arrays import Samples, physical
from parallel_robot.bags.run import run_log
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_sim.ideal_torque import IdealTorque
from parallel_robot_sim.motions import SimulatedMotions
from parallel_robot_sim.simulation import Simulation


def summarise(
    log: run_log.RunLog, found: metrics.Metrics, timed: timing.Timing, failure: str = ''
) -> dict[str, Any]:
    """Metrics and timing as plain data, for JSON; of a run that failed, why in their place."""
    return {
        'scenario': log.scenario,
        'law': log.law,
        'duration_s': found.duration_s,
        **({'failure': failure} if failure else as_data(found)),
        'timing': timing.as_json(timed),
        'messages': {name: asdict(count) for name, count in log.messages.items()},
    }


def tables(result: dict[str, Any], found: metrics.Metrics, planned: float = 0.0) -> list[Part]:
    """Metrics and messages.

    Args:
        result: See :func:`summarise`.
        found: The metrics.
        planned: How long the motion was to be [s]; 0 if not known.
    """
    rows = [
        [name, f'{count["count"]}', f'{count["missing"]}']
        for name, count in result['messages'].items()
    ]
    messages = Table(['messages', 'count', 'missing'], rows)
    if 'failure' in result:
        names = f'{result["scenario"]}, {result["law"]}'
        why = (
            f'{names}, {result["duration_s"]:g} s: no figures of a run that was '
            f'{result["failure"]}; --from and --to choose a part'
        )
        return [why, messages]
    lines = head(result['scenario'], result['law'], found, planned).split('\n')
    return [*lines, whole(found), messages]


# What is known of a motion for which the bag has no reference.


class MotionAlone:
    """Tells what is known of a motion that comes in windows."""

    def __init__(self) -> None:
        self._log: RunLog | None = None
        self._ends = math.nan, math.nan
        self._steps = Quantiles()
        self._count = 0
        self._rows: dict[str, np.ndarray] = {}
        self._measured = True, True
        self._curves = Curves()  # joints and torques

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        if not len(log.time):
            return
        time, first = log.time, self._log is None
        self._steps.add(np.diff(time) if first else np.diff(time, prepend=self._ends[1]))
        self._ends = float(time[0]) if first else self._ends[0], float(time[-1])
        self._log, self._count = log, self._count + len(time)
        speeds, torques = self._measured
        known = log.has_efforts or bool(len(log.command))  # else nothing tells a torque
        self._measured = speeds and log.has_velocities, torques and known
        self._curves.add(time, np.hstack([log.position, log.effort]))
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

    def drawn(self, draw: Callable[..., None], path: Path) -> None:
        """Draw joints and torques into a file by :func:`figures.draw_motion`."""
        log = self._taken
        position, torque = np.hsplit(self._curves.values, 2)
        draw(self._curves.time, log.joints, position, torque, path, log.units)

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


# Metrics of a simulation that comes in parts: of its true motion, and of what is seen of it.


class SimulatedFigures:
    """Those of :func:`metrics.figures`, in memory that does not grow."""

    def __init__(self) -> None:
        self._error: ParallelRobotError | None = None
        self._motions: SimulatedMotions | None = None
        self._columns = MotionColumns()

    def add(self, part: Simulation) -> None:
        """Take the next part; what has no metrics is told at the end."""
        if self._error is not None:
            return
        try:
            if self._motions is None:
                self._motions = SimulatedMotions(part.configuration)
                self._ideal = IdealTorque(part.configuration.trajectory, part.configuration)
            stop = part.first + part.run.steps
            self._columns.add(self._motions.of(part, self._ideal.between(part.first, stop)))
        except ParallelRobotError as error:
            self._error = error

    def result(self) -> Metrics:
        """The metrics, when all parts are there.

        Raises:
            ParallelRobotError: why there are none.
        """
        if self._error is not None:
            raise self._error
        return metrics.figures(self._columns.motions())


# The cross-coupling errors of a bag.


def cross_coupling_of(log: RunLog, errors: Samples | None) -> Series | None:
    """Cross-coupling errors of a run from t = 0 on; None when its bag has none."""
    if errors is None:
        return None
    used = physical(errors) & (errors.stamps >= log.start_stamp)
    if not used.any():
        return None
    time = (errors.stamps[used] - log.start_stamp) / NANOSECONDS
    return Series(time, errors.numbers['position'][used])
