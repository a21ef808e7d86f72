"""Integrals of a law by forward Euler, right for any time between two samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel

Array = NDArray[np.float64]


class Integral(NamedTuple):
    """An integral at the last sample and its rate there, each shape (n,).

    It advances when the next sample comes, for only then is the time between the two known: a
    state that the controller did not see makes it twice as long.
    """

    value: Array
    rate: Array


def zero_integral(joints: int) -> Integral:
    """An integral that begins at zero."""
    return Integral(np.zeros(joints), np.zeros(joints))


@kernel
def advanced(integral: Integral, dt: float) -> Array:
    """Value of an integral `dt` [s] after the last sample, shape (n,)."""
    return integral.value + dt * integral.rate
