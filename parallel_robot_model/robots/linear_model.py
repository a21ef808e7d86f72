"""Equations of motion written as linear in their parameters: what identification needs of a robot.

A robot module may have an attribute ``linear_model`` of this kind; without it, the robot cannot be
identified. The functions are NumPy, not kernels.
"""

from __future__ import annotations

from typing import Any, Protocol

from parallel_robot_model.common.units import Array


class LinearModel(Protocol):
    """M thdd + Q thd + gravity = Y(theta, thd, thdd) p, with p the parameters of the inertia.

    It may have ``sizes(robot)``, magnitudes to which errors of p are compared, shape (P,); without
    it they are those of `values`.

    Attributes:
        NAMES: Text that says what the names of p mean.
    """

    NAMES: str

    def units(self, robot: Any, /) -> dict[str, str]:
        """Names of p with their units; the later ones are regrouped into the earlier ones."""

    def values(self, robot: Any, /) -> Array:
        """p of a robot, shape (P,)."""

    def regressor(
        self, robot: Any, pose: Array, position: Array, velocity: Array, acceleration: Array, /
    ) -> Array:
        """Y at each sample; of the robot, the geometry alone counts.

        Args:
            robot: Parameters of the robot.
            pose: Poses, shape (N, m).
            position: Actuated joints [rad], shape (N, n).
            velocity: Their rates [rad/s], shape (N, n).
            acceleration: Their accelerations [rad/s^2], shape (N, n).

        Returns:
            Shape (N, n, P).
        """

    def free(self, robot: Any, /) -> dict[str, tuple[float, float]]:
        """Keys of the robot on which p depends, with their physical range."""
