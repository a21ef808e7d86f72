"""Equations of motion in pose and in actuated coordinates.

Per leg, coordinates (theta, beta): a = I1 + m1 lc1^2 + m2 l1^2, b = I2 + m2 lc2^2, h = m2 l1 lc2,

    M_leg = [[a, h cos psi], [h cos psi, b]]
    C_leg = [[0, -h sin psi betadot], [h sin psi thetadot, 0]]

and the platform diag(mp, mp, Ip). In the pose, minimal coordinates, everything has a closed form;
the actuated form of the paper's eq. (1) follows with J = H^-1, Xdot = J thetadot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cross, dot, kernel, select, vector
from parallel_robot_model.robots.contract import Model
from parallel_robot_model.robots.joint_load import JointLoad, net_torque
from parallel_robot_model.robots.planar_3rrr.kinematics import (
    Constants,
    Posture,
    RobotParameters,
    posture_at,
)

# Velocity maps: rates of the joints by the rate of the pose, and their time derivatives.


class Columns(NamedTuple):
    """A matrix of shape (3, 3) by its columns, for x, y and phi; an element belongs to a leg."""

    x: Array
    y: Array
    phi: Array


class Maps(NamedTuple):
    """Velocity maps at a posture, thetadot = H Xdot, betadot = K Xdot, each with a row a leg."""

    H: Array
    K: Array


class Rates(NamedTuple):
    """Rates of the joints, each shape (3,) [rad/s], and of the platform angle [rad/s]."""

    theta: Array
    beta: Array
    phi: float


@kernel
def jacobian_x(robot: Constants, posture: Posture) -> Columns:
    """Parallel Jacobian of Jx Xdot = Jq thetadot; row i is [cos b, sin b, l3 sin(b - phi - g)]."""
    turning = posture.sb * posture.arm_x - posture.cb * posture.arm_y
    return Columns(posture.cb, posture.sb, turning)


@kernel
def jacobian_q(robot: Constants, posture: Posture) -> Array:
    """Serial Jacobian of Jx Xdot = Jq thetadot: its diagonal l1 sin psi_i [m], shape (3,)."""
    return robot.l1 * posture.sin_psi


@kernel
def velocity_maps(robot: Constants, posture: Posture) -> Maps:
    """H and K, from the loop closure differentiated once; not finite at a type 1 singularity.

    With C_i the platform joint, l1 sin(psi) thetadot = u(beta)^T Cdot and
    -l2 sin(psi) betadot = u(theta)^T Cdot, where Cdot = (xdot, ydot) + phidot (-arm_y, arm_x).
    """
    inverse = 1.0 / posture.sin_psi
    to_theta, to_beta = inverse * robot.per_l1, -inverse * robot.per_l2
    ct, st, cb, sb = posture.ct, posture.st, posture.cb, posture.sb
    H = to_theta * cb, to_theta * sb, to_theta * (sb * posture.arm_x - cb * posture.arm_y)
    K = to_beta * ct, to_beta * st, to_beta * (st * posture.arm_x - ct * posture.arm_y)
    return Maps(np.transpose(vector(H)), np.transpose(vector(K)))


@kernel
def rates_of(maps: Maps, rate: Array) -> Rates:
    """Rates of the joints at a rate of the pose [m/s, m/s, rad/s], shape (3,)."""
    return Rates(maps.H @ rate, maps.K @ rate, rate[2])


@kernel
def map_rates(robot: Constants, posture: Posture, maps: Maps, rates: Rates) -> Maps:
    """Time derivatives of H and K while the joints move."""
    inverse = 1.0 / posture.sin_psi
    to_theta, to_beta = inverse * robot.per_l1, -inverse * robot.per_l2
    ct, st, cb, sb = posture.ct, posture.st, posture.cb, posture.sb
    arm_x, arm_y = posture.arm_x, posture.arm_y
    shrink = posture.cos_psi * inverse * (rates.beta - rates.theta)
    along_beta = (cb * arm_x + sb * arm_y) * (rates.beta - rates.phi)
    along_theta = (ct * arm_x + st * arm_y) * (rates.theta - rates.phi)
    H = -to_theta * sb * rates.beta, to_theta * cb * rates.beta, to_theta * along_beta
    K = -to_beta * st * rates.theta, to_beta * ct * rates.theta, to_beta * along_theta
    H_dot = np.transpose(vector(H)) - shrink * maps.H
    return Maps(H_dot, np.transpose(vector(K)) - shrink * maps.K)


@kernel
def centripetal(robot: Constants, posture: Posture, rates: Rates) -> tuple[Array, Array]:
    """Accelerations of theta and beta at Xdd = 0, i.e. Hdot Xdot and Kdot Xdot, each shape (3,).

    The loop closure differentiated twice, multiplied by u(beta) and by u(theta).
    """
    inverse = 1.0 / posture.sin_psi
    theta2, beta2 = rates.theta * rates.theta, rates.beta * rates.beta
    phi2 = rates.phi * rates.phi
    arm_x, arm_y, cos_psi = posture.arm_x, posture.arm_y, posture.cos_psi
    along_beta = phi2 * (posture.cb * arm_x + posture.sb * arm_y)
    along_theta = phi2 * (posture.ct * arm_x + posture.st * arm_y)
    theta = robot.l1 * theta2 * cos_psi + robot.l2 * beta2 - along_beta
    beta = robot.l1 * theta2 + robot.l2 * beta2 * cos_psi - along_theta
    return inverse * robot.per_l1 * theta, -inverse * robot.per_l2 * beta


@kernel
def pose_inertia(robot: Constants, posture: Posture, maps: Maps) -> Array:
    """M_x = sum over the legs of [H; K]^T M_leg [H; K], plus that of the platform."""
    H, K = maps
    m = robot.h * posture.cos_psi
    M = np.transpose(H) @ (robot.a * H + m * K) + np.transpose(K) @ (m * H + robot.b * K)
    xx, yy, pp = robot.mp + M[0, 0], robot.mp + M[1, 1], robot.Ip + M[2, 2]
    return symmetric(xx, M[0, 1], M[0, 2], yy, M[1, 2], pp)


@kernel
def symmetric(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> Array:
    """A symmetric matrix by the elements on its diagonal and right of it."""
    return vector((vector((xx, xy, xz)), vector((xy, yy, yz)), vector((xz, yz, zz))))


@kernel
def pose_coriolis(
    robot: Constants, posture: Posture, maps: Maps, maps_dot: Maps, rates: Rates
) -> Array:
    """Q_x: sum over the legs of [H; K]^T (M_leg [Hdot; Kdot] + C_leg [H; K])."""
    m, n = robot.h * posture.cos_psi, robot.h * posture.sin_psi
    (H, K), (H_dot, K_dot) = maps, maps_dot
    p = robot.a * H_dot + m * K_dot - n * rates.beta * K
    r = m * H_dot + robot.b * K_dot + n * rates.theta * H
    return np.transpose(H) @ p + np.transpose(K) @ r


@kernel
def inverse_rows(columns: Columns) -> tuple[Array, Array, Array, float]:
    """Rows of the inverse of a matrix of shape (3, 3), and its determinant."""
    x, y, phi = columns
    first = cross(y, phi)
    determinant = dot(first, x)
    s = 1.0 / determinant
    return s * first, s * cross(phi, x), s * cross(x, y), determinant


@kernel
def actuated_dynamics(robot: Constants, posture: Posture, theta_dot: Array) -> Model:
    """Inertia and Coriolis matrix in actuated coordinates, eq. (1).

    M = J^T M_x J,  Q = J^T (Q_x - M_x J H_dot) J.

    Args:
        robot: The robot.
        posture: Its posture.
        theta_dot: Actuated rates [rad/s], shape (3,).

    Returns:
        M and Q; not finite at a singularity.
    """
    # 1. Xdot = Jx^-1 Jq thetadot, and with it the rates of all joints and of the maps.
    ix, iy, ip, _ = inverse_rows(jacobian_x(robot, posture))
    driven = jacobian_q(robot, posture) * theta_dot
    rate = vector((dot(ix, driven), dot(iy, driven), dot(ip, driven)))
    maps = velocity_maps(robot, posture)
    rates = rates_of(maps, rate)
    maps_dot = map_rates(robot, posture, maps, rates)
    # 2. J = H^-1 = Jx^-1 Jq.
    q = jacobian_q(robot, posture)
    J = vector((ix * q, iy * q, ip * q))
    # 3. M = J^T (M_x J).
    MJ, J_t = pose_inertia(robot, posture, maps) @ J, np.transpose(J)
    M = J_t @ MJ
    M = symmetric(M[0, 0], M[0, 1], M[0, 2], M[1, 1], M[1, 2], M[2, 2])
    # 4. Q = J^T (Q_x - (M_x J) H_dot) J.
    Q_x = pose_coriolis(robot, posture, maps, maps_dot, rates)
    Q = J_t @ ((Q_x - MJ @ maps_dot.H) @ J)
    return Model(M, Q, 0.0 * q)


@kernel
def acceleration(
    robot: Constants, load: JointLoad, pose: Array, rate: Array, torque: Array, time: float
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
    posture = posture_at(robot, pose)
    maps = velocity_maps(robot, posture)
    rates = rates_of(maps, rate)
    # 1. Q_x Xdot: inertial and Coriolis torques of the legs at Xdd = 0.
    theta, beta = centripetal(robot, posture, rates)
    m, n = robot.h * posture.cos_psi, robot.h * posture.sin_psi
    drive = net_torque(load, torque, rates.theta, time)
    p = drive - (robot.a * theta + m * beta - n * (rates.beta * rates.beta))
    r = m * theta + robot.b * beta + n * (rates.theta * rates.theta)
    # 2. Force in the pose.
    force = np.transpose(maps.H) @ p - np.transpose(maps.K) @ r
    # 3. M_x Xdd = force by the adjugate of the symmetric M_x.
    M = pose_inertia(robot, posture, maps)
    adjugate = vector((cross(M[1], M[2]), cross(M[2], M[0]), cross(M[0], M[1])))
    return (1.0 / dot(M[0], adjugate[0])) * (adjugate @ force)


# How far the robot is from its singularities.


class Singularity(NamedTuple):
    """Distance measures, dimensionless and zero at the singularity."""

    type_1: float  # smallest |sin psi_i|: a leg stretched or folded
    leg: int  # 0-based index of that leg
    type_2: float  # |det Jx| / l3: the platform yields although all motors are locked


@kernel
def type_2_measure(robot: Constants, posture: Posture) -> float:
    """det Jx / l3, signed."""
    x, y, phi = jacobian_x(robot, posture)
    return dot(x, cross(y, phi)) * robot.per_l3


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
