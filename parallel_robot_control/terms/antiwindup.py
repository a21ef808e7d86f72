"""Conditional integration: the integrals of a law do not wind up while the torque is limited."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, select, some


@kernel
def unless_saturated(increment: Array, excess: Array) -> Array:
    """Increments of integrals in the torque; zero where they would increase the excess.

    Args:
        increment: Increment of the integral of each joint, shape (n,).
        excess: Torque beyond the limits [N m], shape (n,).

    Source:
        Astrom, Haegglund (1995), PID Controllers, section 3.5, conditional integration.
    """
    return select(increment * excess > 0.0, 0.0, increment)


@kernel
def unless_any_saturated(increment: Array, excess: Array) -> Array:
    """The increments, shape (n,); zero for all joints while any joint is saturated.

    For integrals of differences between joints: their sum remains zero.
    """
    return select(some(excess != 0.0), np.zeros_like(increment), increment)
