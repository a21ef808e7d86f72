"""The results of a run, of a motion alone, or of a simulation in parts: plain data and tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis import metrics, timing
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.readable_metrics import as_data, head, whole
from parallel_robot.analysis.thinned import Curves, Series
from parallel_robot.bags.columns import BLOCK, MotionColumns, blocks
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
    """Tells what is known of a motion."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        # median time between two states [s]
        self._period = float(np.median(np.diff(log.time[:BLOCK]))) if len(log.time) > 1 else np.nan

    def parts(self) -> list[Part]:
        """Length, rate, and for each joint span, speed and torque."""
        log = self._log
        length, period = log.time[-1] - log.time[0], 1e3 * self._period
        head = f'{len(log.time)} states in {length:g} s, one in {period:.4g} ms'
        rows = [[name, *(f'{value:.4f}' for value in row)] for name, row in self._of().items()]
        return [
            f'{log.scenario}, {head}: no reference, so no errors',
            Table(['', *log.joints], rows),
        ]

    def drawn(self, draw: Callable[..., None], path: Path) -> None:
        """Draw joints and torques into a file by :func:`figures.draw_motion`."""
        log = self._log
        curves = Curves()
        for rows in blocks(0, len(log.time)):
            curves.add(log.time[rows], np.hstack([log.position[rows], log.effort[rows]]))
        position, torque = np.hsplit(curves.values, 2)
        draw(curves.time, log.joints, position, torque, path, log.units)

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        log = self._log
        joints = {
            name: dict(zip(log.joints, map(float, row), strict=True))
            for name, row in self._of().items()
        }
        return {
            'scenario': log.scenario,
            'states': len(log.time),
            'duration_s': float(log.time[-1] - log.time[0]),
            'period_s': self._period,
            'joints': joints,
        }

    def _of(self) -> dict[str, np.ndarray]:
        """Figures of each joint by name with unit, shape (n,)."""
        log, units = self._log, self._log.units
        parts = [*blocks(0, len(log.time))]
        what = 'position' if any(units.slides) else 'angle'
        rows = {
            f'lowest {what} [rad]': np.min([log.position[k].min(axis=0) for k in parts], axis=0),
            f'highest {what} [rad]': np.max([log.position[k].max(axis=0) for k in parts], axis=0),
        }
        if log.has_velocities:
            rows['velocity, rms [rad/s]'] = _rms(log.velocity)
        if log.has_efforts or len(log.command):  # else nothing tells a torque
            rows['torque, rms [N m]'] = _rms(log.effort)
            rows['torque, max [N m]'] = np.max(
                [np.abs(log.effort[k]).max(axis=0) for k in parts], axis=0
            )
        return {units.label(name): numbers for name, numbers in rows.items()}


def _rms(values: np.ndarray) -> np.ndarray:
    """Root mean square of each column, shape (n,)."""
    squares = [np.sum(values[rows] ** 2, axis=0) for rows in blocks(0, len(values))]
    found: np.ndarray = np.sqrt(np.sum(squares, axis=0) / len(values))
    return found


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
