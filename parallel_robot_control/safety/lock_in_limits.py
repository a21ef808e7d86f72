"""Whether the safety limits leave room for the sine of the lock-in."""

from __future__ import annotations

import numpy as np

from parallel_robot_control.estimation.lock_in import LockIn
from parallel_robot_control.safety.limiting import Limits
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, Array, JointUnits

LIMIT_SHARE = 0.5  # share of a safety limit that the sine may take


def check(lock_in: LockIn, limits: Limits, inertia: Array, units: JointUnits = HINGES) -> None:
    """Refuse a sine for which the safety limits leave no room.

    Args:
        lock_in: The lock-in.
        limits: Limits of torque, rate and speed.
        inertia: Inertia matrix at the beginning [kg m^2], shape (n, n).
        units: Units of the joints.

    Raises:
        InputError: it takes more than half of a limit.
    """
    torque, frequency = np.asarray(lock_in.torque), lock_in.frequency
    speed = np.abs(np.linalg.solve(inertia, torque)) / frequency
    for takes, limit, key, unit in (
        (torque, limits.torque, 'torque_limit', 'N m'),
        (frequency * torque, limits.rate, 'torque_rate', 'N m/s'),
        (speed, limits.speed, 'speed_limit', 'rad/s'),
    ):
        over = np.flatnonzero(takes > LIMIT_SHARE * np.asarray(limit))
        if over.size:
            i = int(over[0])
            value = float(torque[i]) * LIMIT_SHARE * float(limit[i]) / float(takes[i])
            told = units.one(i).of
            raise InputError(
                f'lock_in.torque must be at most {value:.3g} {told("N m")} at joint {i + 1}, not '
                f'{torque[i]:g}: it takes {takes[i]:.3g} {told(unit)} of safety.{key}, '
                f'{limit[i]:g}',
                'lock_in.torque',
            )
