"""Synchronisation errors of joints coupled in a ring, eqs. (8)-(9)."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel


def synchronisation_error(error: Array) -> Array:
    """e_s,i = e_i - e_(i+1) around the ring, shape (..., n); its unit is that of `error`."""
    return error - np.concatenate([error[..., 1:], error[..., :1]], axis=-1)  # np.roll is slow


@kernel
def coupling(error: Array) -> Array:
    """De_i = e_s,i - e_s,(i-1) = 2 e_i - e_(i-1) - e_(i+1), shape (n,)."""
    return 2.0 * error - np.roll(error, 1) - np.roll(error, -1)
