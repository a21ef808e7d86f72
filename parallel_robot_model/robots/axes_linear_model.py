"""The axes' equations of motion, linear in the inertia of each axis: tau_i = I_i qdd_i."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import Bodies, amount

NAMES = 'inertia1, inertia2, ...: motor and load of each axis'


def units(robot: Any) -> dict[str, str]:
    """Names with units."""
    return {f'inertia{axis}': 'kg m^2' for axis in range(1, len(robot.inertia) + 1)}


def values(robot: Any) -> Array:
    """Inertia of each axis."""
    return np.array(robot.inertia)


def bodies(robot: Any) -> Bodies:
    """Each axis has an inertia."""
    each = np.eye(len(robot.inertia))
    known = {f'inertia{axis}': amount(row) for axis, row in enumerate(each, 1)}
    blocks = tuple(row[np.newaxis, np.newaxis] for row in each)
    return Bodies(np.array(robot.inertia), each, np.zeros(len(each)), blocks, known)


def parameters(robot: Any, numbers: Array) -> dict[str, Any]:
    """The inertias."""
    return {'inertia': tuple(numbers)}


def regressor(
    robot: Any, pose: Array, position: Array, velocity: Array, acceleration: Array
) -> Array:
    """Y at each sample, shape (N, n, n); arguments as in LinearModel."""
    return acceleration[:, :, np.newaxis] * np.eye(acceleration.shape[1])
