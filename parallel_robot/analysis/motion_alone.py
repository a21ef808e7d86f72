"""What is known of a motion for which the bag has no reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot.bags.run_log import RunLog
from parallel_robot_model.common.tables import Part, Table


def parts(log: RunLog) -> list[Part]:
    """Length, rate, and for each joint span, speed and torque."""
    time = log.time
    head = f'{len(time)} states in {time[-1] - time[0]:g} s, one in {1e3 * _period(log):.4g} ms'
    rows = [[name, *(f'{value:.4f}' for value in values)] for name, values in _of(log).items()]
    return [
        f'{log.scenario}, {head}: no reference, so no errors',
        Table(['', *log.joints], rows),
    ]


def as_data(log: RunLog) -> dict[str, Any]:
    """The same as plain data."""
    joints = {
        name: dict(zip(log.joints, map(float, values), strict=True))
        for name, values in _of(log).items()
    }
    return {
        'scenario': log.scenario,
        'states': len(log.time),
        'duration_s': float(log.time[-1] - log.time[0]),
        'period_s': _period(log),
        'joints': joints,
    }


def _period(log: RunLog) -> float:
    """Median time between two states [s]."""
    return float(np.median(np.diff(log.time))) if len(log.time) > 1 else np.nan


def _of(log: RunLog) -> dict[str, np.ndarray]:
    """Figures of each joint by name with unit, shape (n,)."""
    rows = {
        'lowest angle [rad]': log.position.min(axis=0),
        'highest angle [rad]': log.position.max(axis=0),
    }
    if log.has_velocities:
        rows['velocity, rms [rad/s]'] = np.sqrt(np.mean(log.velocity**2, axis=0))
    if log.has_efforts:
        rows['torque, rms [N m]'] = np.sqrt(np.mean(log.effort**2, axis=0))
        rows['torque, max [N m]'] = np.abs(log.effort).max(axis=0)
    return rows
