"""The axes' equations of motion, linear in the inertia of each axis: tau_i = I_i qdd_i."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array

NAMES = 'inertia1, inertia2, ...: motor and load of each axis'


def units(robot: Any) -> dict[str, str]:
    """Names with units."""
    return {f'inertia{axis}': 'kg m^2' for axis in range(1, len(robot.inertia) + 1)}


def values(robot: Any) -> Array:
    """Inertia of each axis."""
    return np.array(robot.inertia)


def free(robot: Any) -> dict[str, tuple[float, float]]:
    """The inertia is positive."""
    return {'inertia': (0.0, np.inf)}


def regressor(
    robot: Any, pose: Array, position: Array, velocity: Array, acceleration: Array
) -> Array:
    """Y at each sample, shape (N, n, n); arguments as in LinearModel."""
    return acceleration[:, :, np.newaxis] * np.eye(acceleration.shape[1])
