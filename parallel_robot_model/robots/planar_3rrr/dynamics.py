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
    """Velocity maps at a posture: thetadot = H Xdot, betadot = K Xdot."""

    H: Columns
    K: Columns


class Rates(NamedTuple):
    """Rates of the joints, each shape (3,) [rad/s], and of the platform angle [rad/s]."""

    theta: Array
    beta: Array
    phi: float


@kernel
def apply(columns: Columns, rate: Array) -> Array:
    """Product of a matrix and a vector of shape (3,)."""
    return columns.x * rate[0] + columns.y * rate[1] + columns.phi * rate[2]


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
    return Maps(
        Columns(
            to_theta * cb,
            to_theta * sb,
            to_theta * (sb * posture.arm_x - cb * posture.arm_y),
        ),
        Columns(
            to_beta * ct,
            to_beta * st,
            to_beta * (st * posture.arm_x - ct * posture.arm_y),
        ),
    )


@kernel
def rates_of(maps: Maps, rate: Array) -> Rates:
    """Rates of the joints at a rate of the pose [m/s, m/s, rad/s], shape (3,)."""
    return Rates(apply(maps.H, rate), apply(maps.K, rate), rate[2])


@kernel
def map_rates(robot: Constants, posture: Posture, maps: Maps, rates: Rates) -> Maps:
    """Time derivatives of H and K while the joints move."""
    inverse = 1.0 / posture.sin_psi
    to_theta, to_beta = inverse * robot.per_l1, -inverse * robot.per_l2
    ct, st, cb, sb = posture.ct, posture.st, posture.cb, posture.sb
    arm_x, arm_y = posture.arm_x, posture.arm_y
    H, K = maps
    shrink = posture.cos_psi * inverse * (rates.beta - rates.theta)
    along_beta = (cb * arm_x + sb * arm_y) * (rates.beta - rates.phi)
    along_theta = (ct * arm_x + st * arm_y) * (rates.theta - rates.phi)
    return Maps(
        Columns(
            -to_theta * sb * rates.beta - shrink * H.x,
            to_theta * cb * rates.beta - shrink * H.y,
            to_theta * along_beta - shrink * H.phi,
        ),
        Columns(
            -to_beta * st * rates.theta - shrink * K.x,
            to_beta * ct * rates.theta - shrink * K.y,
            to_beta * along_theta - shrink * K.phi,
        ),
    )


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


class Symmetric(NamedTuple):
    """A symmetric matrix of shape (3, 3) in pose coordinates."""

    xx: float
    xy: float
    xp: float
    yy: float
    yp: float
    pp: float


class Row(NamedTuple):
    """A row of a matrix of shape (3, 3) in pose coordinates."""

    x: float
    y: float
    phi: float


@kernel
def pose_inertia(robot: Constants, posture: Posture, maps: Maps) -> Symmetric:
    """M_x = sum over the legs of [H; K]^T M_leg [H; K], plus that of the platform."""
    (hx, hy, hp), (kx, ky, kp) = maps
    m = robot.h * posture.cos_psi
    x, y, p = robot.a * hx + m * kx, robot.a * hy + m * ky, robot.a * hp + m * kp
    u, v, w = m * hx + robot.b * kx, m * hy + robot.b * ky, m * hp + robot.b * kp
    return Symmetric(
        robot.mp + (dot(hx, x) + dot(kx, u)),
        dot(hx, y) + dot(kx, v),
        dot(hx, p) + dot(kx, w),
        robot.mp + (dot(hy, y) + dot(ky, v)),
        dot(hy, p) + dot(ky, w),
        robot.Ip + (dot(hp, p) + dot(kp, w)),
    )


@kernel
def pose_coriolis(
    robot: Constants, posture: Posture, maps: Maps, maps_dot: Maps, rates: Rates
) -> tuple[Row, Row, Row]:
    """Q_x, by rows: sum over the legs of [H; K]^T (M_leg [Hdot; Kdot] + C_leg [H; K])."""
    m, n = robot.h * posture.cos_psi, robot.h * posture.sin_psi
    H, K = maps
    H_dot, K_dot = maps_dot
    down, up = n * rates.beta, n * rates.theta
    px = robot.a * H_dot.x + m * K_dot.x - down * K.x
    py = robot.a * H_dot.y + m * K_dot.y - down * K.y
    pp = robot.a * H_dot.phi + m * K_dot.phi - down * K.phi
    rx = m * H_dot.x + robot.b * K_dot.x + up * H.x
    ry = m * H_dot.y + robot.b * K_dot.y + up * H.y
    rp = m * H_dot.phi + robot.b * K_dot.phi + up * H.phi
    return (
        Row(dot(H.x, px) + dot(K.x, rx), dot(H.x, py) + dot(K.x, ry), dot(H.x, pp) + dot(K.x, rp)),
        Row(dot(H.y, px) + dot(K.y, rx), dot(H.y, py) + dot(K.y, ry), dot(H.y, pp) + dot(K.y, rp)),
        Row(
            dot(H.phi, px) + dot(K.phi, rx),
            dot(H.phi, py) + dot(K.phi, ry),
            dot(H.phi, pp) + dot(K.phi, rp),
        ),
    )


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
    # 2. The rows of J = H^-1 = Jx^-1 Jq.
    q = jacobian_q(robot, posture)
    jx, jy, jp = ix * q, iy * q, ip * q
    # 3. M = J^T (M_x J).
    inertia = pose_inertia(robot, posture, maps)
    mx = inertia.xx * jx + inertia.xy * jy + inertia.xp * jp
    my = inertia.xy * jx + inertia.yy * jy + inertia.yp * jp
    mp = inertia.xp * jx + inertia.yp * jy + inertia.pp * jp
    m01 = jx[0] * mx[1] + jy[0] * my[1] + jp[0] * mp[1]
    m02 = jx[0] * mx[2] + jy[0] * my[2] + jp[0] * mp[2]
    m12 = jx[1] * mx[2] + jy[1] * my[2] + jp[1] * mp[2]
    M = vector(
        (
            vector((jx[0] * mx[0] + jy[0] * my[0] + jp[0] * mp[0], m01, m02)),
            vector((m01, jx[1] * mx[1] + jy[1] * my[1] + jp[1] * mp[1], m12)),
            vector((m02, m12, jx[2] * mx[2] + jy[2] * my[2] + jp[2] * mp[2])),
        )
    )
    # 4. Q = J^T (Q_x - (M_x J) H_dot) J, whose factors in pose coordinates are three rows.
    H_dot = maps_dot.H
    row_x, row_y, row_p = pose_coriolis(robot, posture, maps, maps_dot, rates)
    qx = (
        (row_x.x - dot(mx, H_dot.x)) * jx
        + (row_x.y - dot(mx, H_dot.y)) * jy
        + (row_x.phi - dot(mx, H_dot.phi)) * jp
    )
    qy = (
        (row_y.x - dot(my, H_dot.x)) * jx
        + (row_y.y - dot(my, H_dot.y)) * jy
        + (row_y.phi - dot(my, H_dot.phi)) * jp
    )
    qp = (
        (row_p.x - dot(mp, H_dot.x)) * jx
        + (row_p.y - dot(mp, H_dot.y)) * jy
        + (row_p.phi - dot(mp, H_dot.phi)) * jp
    )
    Q = vector(
        (
            jx[0] * qx + jy[0] * qy + jp[0] * qp,
            jx[1] * qx + jy[1] * qy + jp[1] * qp,
            jx[2] * qx + jy[2] * qy + jp[2] * qp,
        )
    )
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
    # 2. Forces in the pose.
    H, K = maps
    fx = dot(H.x, p) - dot(K.x, r)
    fy = dot(H.y, p) - dot(K.y, r)
    fp = dot(H.phi, p) - dot(K.phi, r)
    # 3. M_x Xdd = force by the adjugate of the symmetric M_x.
    M = pose_inertia(robot, posture, maps)
    axx = M.yy * M.pp - M.yp * M.yp
    axy = M.xp * M.yp - M.xy * M.pp
    axp = M.xy * M.yp - M.xp * M.yy
    ayy = M.xx * M.pp - M.xp * M.xp
    ayp = M.xy * M.xp - M.xx * M.yp
    app = M.xx * M.yy - M.xy * M.xy
    scale = 1.0 / (M.xx * axx + M.xy * axy + M.xp * axp)
    return vector(
        (
            scale * (axx * fx + axy * fy + axp * fp),
            scale * (axy * fx + ayy * fy + ayp * fp),
            scale * (axp * fx + ayp * fy + app * fp),
        )
    )


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
