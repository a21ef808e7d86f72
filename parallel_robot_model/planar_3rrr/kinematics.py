"""Inverse kinematics, Jacobians, velocity maps and their rates.

Loop closure of leg i, with u(a) = (cos a, sin a), elbow E_i = A_i + l1 u(theta_i):

    P + l3 u(phi + gamma_i) = A_i + l1 u(theta_i) + l2 u(beta_i)

The pose is (x, y, phi) [m, m, rad]; theta_i is the actuated and beta_i the distal angle, both
absolute [rad]; the passive joint is psi_i = beta_i - theta_i.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]


class Legs(NamedTuple):
    """Angles of the three legs at a pose.

    Attributes:
        theta: Actuated angles [rad], shape (3,).
        beta: Absolute angles of the distal links [rad], shape (3,).
        out_of_reach: 0-based index of the first leg that does not reach, -1 when all do.
    """

    theta: Array
    beta: Array
    out_of_reach: int


class Rates(NamedTuple):
    """Velocity maps at a pose, and their time derivatives: thetadot = H Xdot, betadot = K Xdot.

    Attributes:
        H: Pose rate to actuated rates, shape (3, 3).
        K: Pose rate to distal rates, shape (3, 3).
        H_dot: Time derivative of H, shape (3, 3).
        K_dot: Time derivative of K, shape (3, 3).
    """

    H: Array
    K: Array
    H_dot: Array
    K_dot: Array


@kernel
def inverse_kinematics(robot: RobotParameters, pose: Array) -> Legs:
    """Angles of all legs at a pose, in the robot's working mode.

    The direction of a leg is counted from the direction to the centre of the base, so theta is
    continuous wherever a platform joint is not straight behind its base joint.
    """
    theta = np.empty(3)
    beta = np.empty(3)
    out_of_reach = -1
    centre_x = (robot.base_x[0] + robot.base_x[1] + robot.base_x[2]) / 3.0
    centre_y = (robot.base_y[0] + robot.base_y[1] + robot.base_y[2]) / 3.0
    for i in range(3):
        ux = centre_x - robot.base_x[i]
        uy = centre_y - robot.base_y[i]
        if ux == 0.0 and uy == 0.0:
            ux = 1.0
        angle = pose[2] + robot.platform_angle[i]
        rx = pose[0] + robot.l3 * math.cos(angle) - robot.base_x[i]
        ry = pose[1] + robot.l3 * math.sin(angle) - robot.base_y[i]
        c = math.sqrt(rx * rx + ry * ry)
        cosine = (robot.l1 * robot.l1 - robot.l2 * robot.l2 + c * c) / (2.0 * robot.l1 * c)
        if not abs(cosine) < 1.0:
            if out_of_reach < 0:
                out_of_reach = i
            theta[i] = np.nan
            beta[i] = np.nan
            continue
        direction = math.atan2(uy, ux) + math.atan2(ux * ry - uy * rx, ux * rx + uy * ry)
        theta[i] = direction + robot.working_mode[i] * math.acos(cosine)
        dx = rx - robot.l1 * math.cos(theta[i])
        dy = ry - robot.l1 * math.sin(theta[i])
        beta[i] = math.atan2(dy, dx)
    return Legs(theta, beta, out_of_reach)


@kernel
def jacobian_x(robot: RobotParameters, phi: float, beta: Array) -> Array:
    """Parallel Jacobian of Jx Xdot = Jq thetadot; row i is [cos b, sin b, l3 sin(b - phi - g)]."""
    jacobian = np.empty((3, 3))
    for i in range(3):
        jacobian[i, 0] = math.cos(beta[i])
        jacobian[i, 1] = math.sin(beta[i])
        jacobian[i, 2] = robot.l3 * math.sin(beta[i] - phi - robot.platform_angle[i])
    return jacobian


@kernel
def jacobian_q(robot: RobotParameters, theta: Array, beta: Array) -> Array:
    """Serial Jacobian of Jx Xdot = Jq thetadot: its diagonal l1 sin psi_i, shape (3,)."""
    diagonal = np.empty(3)
    for i in range(3):
        diagonal[i] = robot.l1 * math.sin(beta[i] - theta[i])
    return diagonal


@kernel
def velocity_maps(
    robot: RobotParameters, phi: float, theta: Array, beta: Array, rate: Array
) -> Rates:
    """H, K and their rates, from the loop closure differentiated twice.

    With B_i = [1 0 -l3 sin(a); 0 1 l3 cos(a)], a = phi + gamma_i, the platform joint moves with
    B_i Xdot; l1 sin(psi) thetadot = u(beta)^T B Xdot, -l2 sin(psi) betadot = u(theta)^T B Xdot.

    Args:
        robot: The robot.
        phi: Platform angle [rad].
        theta: Actuated angles [rad], shape (3,).
        beta: Distal angles [rad], shape (3,).
        rate: Pose rate [m/s, m/s, rad/s], shape (3,).

    Returns:
        The maps; not finite at a type 1 singularity.
    """
    H = np.empty((3, 3))
    K = np.empty((3, 3))
    H_dot = np.empty((3, 3))
    K_dot = np.empty((3, 3))
    for i in range(3):
        ct, st = math.cos(theta[i]), math.sin(theta[i])
        cb, sb = math.cos(beta[i]), math.sin(beta[i])
        px = robot.l3 * math.cos(phi + robot.platform_angle[i])
        py = robot.l3 * math.sin(phi + robot.platform_angle[i])
        sin_psi = sb * ct - cb * st
        cos_psi = cb * ct + sb * st
        to_theta = 1.0 / (robot.l1 * sin_psi)
        to_beta = -1.0 / (robot.l2 * sin_psi)
        H[i, 0] = to_theta * cb
        H[i, 1] = to_theta * sb
        H[i, 2] = to_theta * (sb * px - cb * py)
        K[i, 0] = to_beta * ct
        K[i, 1] = to_beta * st
        K[i, 2] = to_beta * (st * px - ct * py)
        theta_dot = H[i, 0] * rate[0] + H[i, 1] * rate[1] + H[i, 2] * rate[2]
        beta_dot = K[i, 0] * rate[0] + K[i, 1] * rate[1] + K[i, 2] * rate[2]
        shrink = cos_psi / sin_psi * (beta_dot - theta_dot)
        H_dot[i, 0] = to_theta * -sb * beta_dot - shrink * H[i, 0]
        H_dot[i, 1] = to_theta * cb * beta_dot - shrink * H[i, 1]
        H_dot[i, 2] = to_theta * (cb * px + sb * py) * (beta_dot - rate[2]) - shrink * H[i, 2]
        K_dot[i, 0] = to_beta * -st * theta_dot - shrink * K[i, 0]
        K_dot[i, 1] = to_beta * ct * theta_dot - shrink * K[i, 1]
        K_dot[i, 2] = to_beta * (ct * px + st * py) * (theta_dot - rate[2]) - shrink * K[i, 2]
    return Rates(H, K, H_dot, K_dot)
