"""Velocity maps: rates of the joints by the rate of the pose, and their time derivatives."""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.robots.planar_3rrr.geometry import Constants, Posture


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
