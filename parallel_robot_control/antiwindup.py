"""Conditional integration: no integral of a law winds up while the torque is limited."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel

Array = NDArray[np.float64]


@kernel
def unless_saturated(increment: Array, excess: Array) -> Array:
    """Increments of integrals that add to the torque, zero where they would add to the excess.

    Args:
        increment: What the integral of each joint would grow by, shape (n,).
        excess: Torque beyond the limits [N m], shape (n,).

    Source:
        Astrom, Haegglund (1995), PID Controllers, section 3.5, conditional integration.
    """
    result = np.empty(len(increment))
    for i in range(len(increment)):
        result[i] = 0.0 if increment[i] * excess[i] > 0.0 else increment[i]
    return result


@kernel
def unless_any_saturated(increment: Array, excess: Array) -> Array:
    """The increments, or zero for all joints while one is saturated, shape (n,).

    For integrals over differences of joints: their sum stays what it is, zero.
    """
    for i in range(len(excess)):
        if excess[i] != 0.0:
            return np.zeros(len(increment))
    return increment
