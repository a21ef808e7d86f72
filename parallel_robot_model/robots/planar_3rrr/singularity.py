"""How far the robot is from its singularities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cross, kernel, select
from parallel_robot_model.robots.planar_3rrr.geometry import Constants, Posture, RobotParameters
from parallel_robot_model.robots.planar_3rrr.velocities import jacobian_x


class Singularity(NamedTuple):
    """Distance measures, dimensionless and zero at the singularity.

    Attributes:
        type_1: Smallest |sin psi_i|: a leg stretched or folded.
        leg: 0-based index of that leg.
        type_2: |det Jx| / l3: the platform yields although all motors are locked.
    """

    type_1: float
    leg: int
    type_2: float


@kernel
def type_2_measure(robot: Constants, posture: Posture) -> float:
    """det Jx / l3, signed."""
    x, y, phi = jacobian_x(robot, posture)
    ax, ay, az = cross(y, phi)
    return (x[0] * ax + x[1] * ay + x[2] * az) * robot.per_l3


@kernel
def measures(robot: Constants, posture: Posture) -> Singularity:
    """Distance to both singularities."""
    sines = np.abs(posture.sin_psi)
    second = sines[1] < sines[0]
    smallest = select(second, sines[1], sines[0])
    third = sines[2] < smallest
    leg = select(third, 2, select(second, 1, 0))
    return Singularity(select(third, sines[2], smallest), leg, abs(type_2_measure(robot, posture)))


def condition_numbers(robot: RobotParameters, phi: Array, beta: Array) -> Array:
    """Condition number of Jx, its angle column divided by l3, so dimensionless.

    Args:
        robot: The robot.
        phi: Platform angles [rad], shape (N,).
        beta: Distal angles [rad], shape (N, 3).

    Returns:
        Shape (N,); infinite at a type 2 singularity.
    """
    return np.linalg.cond(_scaled_jacobian(robot, phi, beta))


def determinants(robot: RobotParameters, phi: Array, beta: Array) -> Array:
    """det Jx / l3, signed, shape (N,); arguments as of :func:`condition_numbers`."""
    return np.linalg.det(_scaled_jacobian(robot, phi, beta))


def _scaled_jacobian(robot: RobotParameters, phi: Array, beta: Array) -> Array:
    """Jx with its angle column divided by l3, shape (N, 3, 3)."""
    turning = np.sin(beta - np.asarray(phi)[:, np.newaxis] - np.array(robot.platform_angle))
    return np.stack([np.cos(beta), np.sin(beta), turning], axis=-1)
