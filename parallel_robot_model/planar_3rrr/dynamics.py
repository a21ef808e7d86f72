"""Equations of motion in pose and in actuated coordinates.

Per leg, coordinates (theta, beta): a = I1 + m1 lc1^2 + m2 l1^2, b = I2 + m2 lc2^2, h = m2 l1 lc2,

    M_leg = [[a, h cos psi], [h cos psi, b]]
    C_leg = [[0, -h sin psi betadot], [h sin psi thetadot, 0]]

and the platform diag(mp, mp, Ip). In the pose, minimal coordinates, everything has a closed form;
the actuated form of the paper's eq. (1) follows with J = H^-1, Xdot = J thetadot.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel
from parallel_robot_base.linear_algebra import inverse, multiply, multiply_transposed
from parallel_robot_model.contract import Model
from parallel_robot_model.joint_load import JointLoad, net_torque
from parallel_robot_model.planar_3rrr.kinematics import (
    inverse_kinematics,
    jacobian_q,
    jacobian_x,
    velocity_maps,
)
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]


@kernel
def pose_dynamics(
    robot: RobotParameters, phi: float, theta: Array, beta: Array, rate: Array
) -> tuple[Array, Array, Array, Array]:
    """Inertia and Coriolis matrix in pose coordinates, with the maps H and H_dot.

    Returns:
        M_x and Q_x of M_x Xdd + Q_x Xdot = H^T tau, then H and H_dot; each of shape (3, 3).
    """
    maps = velocity_maps(robot, phi, theta, beta, rate)
    a = robot.I1 + robot.m1 * robot.lc1**2 + robot.m2 * robot.l1**2
    b = robot.I2 + robot.m2 * robot.lc2**2
    h = robot.m2 * robot.l1 * robot.lc2
    M = np.zeros((3, 3))
    Q = np.zeros((3, 3))
    M[0, 0] = robot.mp
    M[1, 1] = robot.mp
    M[2, 2] = robot.Ip
    for i in range(3):
        H, K, H_dot, K_dot = maps.H[i], maps.K[i], maps.H_dot[i], maps.K_dot[i]
        theta_dot = H[0] * rate[0] + H[1] * rate[1] + H[2] * rate[2]
        beta_dot = K[0] * rate[0] + K[1] * rate[1] + K[2] * rate[2]
        m12 = h * math.cos(beta[i] - theta[i])
        c12 = h * math.sin(beta[i] - theta[i])
        for r in range(3):
            for c in range(3):
                M[r, c] += H[r] * (a * H[c] + m12 * K[c]) + K[r] * (m12 * H[c] + b * K[c])
                Q[r, c] += H[r] * (a * H_dot[c] + m12 * K_dot[c] - c12 * beta_dot * K[c]) + K[
                    r
                ] * (m12 * H_dot[c] + b * K_dot[c] + c12 * theta_dot * H[c])
    return M, Q, maps.H, maps.H_dot


@kernel
def actuated_dynamics(
    robot: RobotParameters, phi: float, theta: Array, beta: Array, theta_dot: Array
) -> Model:
    """Inertia and Coriolis matrix in actuated coordinates, eq. (1).

    M = J^T M_x J,  Q = J^T (Q_x - M_x J H_dot) J.

    Args:
        robot: The robot.
        phi: Platform angle [rad].
        theta: Actuated angles [rad], shape (3,).
        beta: Distal angles [rad], shape (3,).
        theta_dot: Actuated rates [rad/s], shape (3,).

    Returns:
        M and Q; not finite at a singularity.
    """
    rate = multiply(
        inverse(jacobian_x(robot, phi, beta)), jacobian_q(robot, theta, beta) * theta_dot
    )
    M_x, Q_x, H, H_dot = pose_dynamics(robot, phi, theta, beta, rate)
    J = inverse(H)
    M = _congruence(J, M_x)
    Q = _congruence(J, Q_x - _product(M_x, _product(J, H_dot)))
    return Model(0.5 * (M + M.T), Q, np.zeros(3))


@kernel
def acceleration(
    robot: RobotParameters,
    load: JointLoad,
    pose: Array,
    rate: Array,
    torque: Array,
    time: float,
) -> Array:
    """Second derivative of the pose: M_x Xdd = H^T (tau - friction - delta) - Q_x Xdot.

    Args:
        robot: The robot.
        load: Friction and disturbance of the actuated joints.
        pose: Pose of the platform [m, m, rad], shape (3,).
        rate: Rate of the pose [m/s, m/s, rad/s], shape (3,).
        torque: Torque of the motors [N m], shape (3,).
        time: Time since the start [s].
    """
    legs = inverse_kinematics(robot, pose)
    M, Q, H, _ = pose_dynamics(robot, pose[2], legs.theta, legs.beta, rate)
    drive = net_torque(load, torque, multiply(H, rate), time)
    force = multiply_transposed(H, drive) - multiply(Q, rate)
    return multiply(inverse(M), force)


@kernel
def _product(a: Array, b: Array) -> Array:
    c = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            c[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return c


@kernel
def _congruence(J: Array, a: Array) -> Array:
    """J^T a J."""
    right = _product(a, J)
    c = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            c[i, j] = J[0, i] * right[0, j] + J[1, i] * right[1, j] + J[2, i] * right[2, j]
    return c
