"""A reference at a stamp between its samples: extrapolated with its own derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import JointReference
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import inner, kernel, read_row, vector, write_row


@inner
def moved_on(reference: JointReference, time: float) -> JointReference:
    """The reference some time after its own [s], or before, with its acceleration held."""
    return JointReference(
        reference.position + time * (reference.velocity + 0.5 * time * reference.acceleration),
        reference.velocity + time * reference.acceleration,
        reference.acceleration,
    )


@kernel
def extrapolate(age: int, position: Array, velocity: Array, acceleration: Array) -> JointReference:
    """A reference some time after its own stamp, at constant acceleration.

    Args:
        age: Time since its stamp [ns].
        position: Desired angles at its stamp [rad], shape (n,), a vector as the others.
        velocity: Their rates [rad/s], shape (n,).
        acceleration: Their accelerations [rad/s^2], shape (n,).
    """
    if age == 0:
        return JointReference(position, velocity, acceleration)
    return moved_on(JointReference(position, velocity, acceleration), age / NANOSECONDS)


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
    row = vector(np.zeros(position.shape[1]))
    p, v, a = map(np.ascontiguousarray, (position, velocity, acceleration))
    return _extrapolate_rows(ages, p, v, a, row)


@kernel
def _extrapolate_rows(
    ages: NDArray[np.int64], position: Array, velocity: Array, acceleration: Array, like: Array
) -> JointReference:
    """See :func:`extrapolate_rows`; `like` is a vector of shape (n,)."""
    shape = position.shape
    later = JointReference(np.empty(shape), np.empty(shape), np.empty(shape))
    for k in range(len(ages)):
        row = extrapolate(
            ages[k],
            read_row(position, k, like),
            read_row(velocity, k, like),
            read_row(acceleration, k, like),
        )
        write_row(later.position, k, row.position)
        write_row(later.velocity, k, row.velocity)
        write_row(later.acceleration, k, row.acceleration)
    return later
