"""Joints coupled in a ring, each with the next one."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array


def synchronisation_error(error: Array) -> Array:
    """e_s,i = e_i - e_(i+1), eqs. (8)-(9), shape (..., n); its unit is that of `error`."""
    return error - np.concatenate([error[..., 1:], error[..., :1]], axis=-1)  # np.roll is slow
