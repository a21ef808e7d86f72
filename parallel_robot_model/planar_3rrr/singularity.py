"""How far the robot is from its singularities."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel
from parallel_robot_base.linear_algebra import determinant
from parallel_robot_model.planar_3rrr.kinematics import jacobian_x
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]


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
def measures(robot: RobotParameters, phi: float, theta: Array, beta: Array) -> Singularity:
    """Distance to both singularities.

    Args:
        robot: The robot.
        phi: Platform angle [rad].
        theta: Actuated angles [rad], shape (3,).
        beta: Distal angles [rad], shape (3,).
    """
    smallest = np.inf
    leg = 0
    for i in range(3):
        sine = abs(math.sin(beta[i] - theta[i]))
        if sine < smallest:
            smallest = sine
            leg = i
    type_2 = abs(determinant(jacobian_x(robot, phi, beta))) / robot.l3
    return Singularity(smallest, leg, type_2)


def condition_numbers(robot: RobotParameters, phi: Array, beta: Array) -> Array:
    """Condition number of Jx, its angle column divided by l3, so dimensionless.

    Args:
        robot: The robot.
        phi: Platform angles [rad], shape (N,).
        beta: Distal angles [rad], shape (N, 3).

    Returns:
        Shape (N,); infinite at a type 2 singularity.
    """
    scale = np.array([1.0, 1.0, robot.l3])
    return np.linalg.cond(_jacobians(robot, np.ascontiguousarray(phi), beta) / scale)


@kernel
def _jacobians(robot: RobotParameters, phi: Array, beta: Array) -> Array:
    """Jx of every sample, shape (N, 3, 3)."""
    jacobians = np.empty((len(phi), 3, 3))
    for k in range(len(phi)):
        jacobians[k] = jacobian_x(robot, phi[k], beta[k])
    return jacobians
