"""A reference at a stamp between its samples: extrapolated with its own derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control.contract import JointReference

Array = NDArray[np.float64]


@kernel
def extrapolate(age: int, position: Array, velocity: Array, acceleration: Array) -> JointReference:
    """A reference some time after its own stamp, at constant acceleration.

    Args:
        age: Time since its stamp [ns].
        position: Desired angles at its stamp [rad], shape (n,).
        velocity: Their rates [rad/s], shape (n,).
        acceleration: Their accelerations [rad/s^2], shape (n,).
    """
    n = len(position)
    later = JointReference(np.empty(n), np.empty(n), np.empty(n))
    dt = age / NANOSECONDS
    for i in range(n):
        p, v, a = position[i], velocity[i], acceleration[i]
        later.position[i] = p + dt * v + 0.5 * dt * dt * a if age else p
        later.velocity[i] = v + dt * a if age else v
        later.acceleration[i] = a
    return later


@kernel
def extrapolate_rows(
    ages: NDArray[np.int64], position: Array, velocity: Array, acceleration: Array
) -> JointReference:
    """References some time after their own stamps, one per row.

    Args:
        ages: Times since their stamps [ns], shape (N,).
        position: Desired angles at their stamps [rad], shape (N, n).
        velocity: Their rates [rad/s], shape (N, n).
        acceleration: Their accelerations [rad/s^2], shape (N, n).
    """
    shape = position.shape
    later = JointReference(np.empty(shape), np.empty(shape), np.empty(shape))
    for k in range(len(ages)):
        row = extrapolate(ages[k], position[k], velocity[k], acceleration[k])
        for i in range(shape[1]):
            later.position[k, i] = row.position[i]
            later.velocity[k, i] = row.velocity[i]
            later.acceleration[k, i] = row.acceleration[i]
    return later
