"""Integrals of a law by forward Euler, for any time between two samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, vector


class Integral(NamedTuple):
    """An integral at the last sample and its rate there, each shape (n,).

    It advances when the next sample comes, because only then is the time between the two known: it
    is twice as long if a state was lost.
    """

    value: Array
    rate: Array


def zero_integral(joints: int) -> Integral:
    """An integral that starts at zero."""
    zero = vector(np.zeros(joints))
    return Integral(zero, zero)


@kernel
def advanced(integral: Integral, dt: float) -> Array:
    """Value of an integral `dt` [s] after the last sample, shape (n,)."""
    return integral.value + dt * integral.rate
