"""Forward kinematics of many postures, each from a pose near its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, read_row, vector, write_row
from parallel_robot_model.robots.contract import FOUND
from parallel_robot_model.robots.registry import RobotModel


class Locator:
    """Forward kinematics of robots of one kind, compiled once for all their parameters."""

    def __init__(self, robot: RobotModel) -> None:
        """Prepare it.

        Raises:
            InputError: the kernel of a custom robot does not compile.
        """
        self._row = vector(np.zeros(robot.module.joints(robot.parameters)))
        self._like = vector(np.zeros(robot.pose_size))
        self._locate = robot.kernel('locate', self._row, self._like)

    def __call__(self, robot: RobotModel, position: Array, guesses: Array) -> Array | None:
        """Poses at joint positions.

        Args:
            robot: The robot.
            position: Actuated joints [rad], shape (N, n).
            guesses: Poses near the wanted ones, shape (N, m).

        Returns:
            Poses, shape (N, m); None where one has none.
        """
        row, like = self._row, self._like
        position, guesses = np.ascontiguousarray(position), np.ascontiguousarray(guesses)
        poses, whole = _located(self._locate, robot.constants, position, guesses, row, like)
        return poses if whole and np.isfinite(poses).all() else None


@kernel
def _located(
    locate: Any, robot: Any, position: Array, guesses: Array, row: Array, like: Array
) -> tuple[Array, bool]:
    """Poses, and whether all of them were found."""
    poses = np.empty((len(position), len(like)))
    for k in range(len(position)):
        found = locate(robot, read_row(position, k, row), read_row(guesses, k, like))
        if found.fault != FOUND:
            return poses, False
        write_row(poses, k, found.pose)
    return poses, True
