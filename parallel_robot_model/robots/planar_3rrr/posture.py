"""Inverse kinematics: the directions of all links at a pose, and their angles.

Loop closure of leg i, with u(a) = (cos a, sin a), base joint A_i, elbow E_i = A_i + l1 u(theta_i):

    P + l3 u(phi + gamma_i) = A_i + l1 u(theta_i) + l2 u(beta_i)

The pose is (x, y, phi) [m, m, rad]; theta_i is the actuated and beta_i the distal angle, both
absolute [rad]; the passive joint is psi_i = beta_i - theta_i. Links are unit vectors as long as
possible: angles are only computed where they go out. A vector of shape (3,) has an element for
each leg.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, select
from parallel_robot_model.robots.contract import REACHED
from parallel_robot_model.robots.planar_3rrr.constants import Constants


class Posture(NamedTuple):
    """Directions of the links, each shape (3,); NaN for a leg that does not reach.

    Attributes:
        arm_x: Platform centre to the platform joint, x [m].
        arm_y: The same, y [m].
        ct: cos theta.
        st: sin theta.
        cb: cos beta.
        sb: sin beta.
        cos_psi: cos psi.
        sin_psi: sin psi.
    """

    arm_x: Array
    arm_y: Array
    ct: Array
    st: Array
    cb: Array
    sb: Array
    cos_psi: Array
    sin_psi: Array


class Legs(NamedTuple):
    """Angles of the three legs at a pose.

    Attributes:
        theta: Actuated angles [rad], shape (3,).
        beta: Absolute angles of the distal links in (-pi, pi] [rad], shape (3,).
        psi: Passive joints in (-pi, pi] [rad], shape (3,).
        out_of_reach: 0-based index of the first leg that does not reach, else REACHED.
    """

    theta: Array
    beta: Array
    psi: Array
    out_of_reach: int


@kernel
def arms(robot: Constants, phi: float) -> tuple[Array, Array]:
    """Platform centre to the platform joints, l3 u(phi + gamma) [m], each shape (3,)."""
    cosine, sine = math.cos(phi), math.sin(phi)
    return (
        cosine * robot.joint_x - sine * robot.joint_y,
        sine * robot.joint_x + cosine * robot.joint_y,
    )


@kernel
def posture_of(arm_x: Array, arm_y: Array, ct: Array, st: Array, cb: Array, sb: Array) -> Posture:
    """Posture with the directions of its links."""
    return Posture(arm_x, arm_y, ct, st, cb, sb, cb * ct + sb * st, sb * ct - cb * st)


@kernel
def posture_at(robot: Constants, pose: Array) -> Posture:
    """Directions of all links at a pose, shape (3,), in the robot's working mode."""
    arm_x, arm_y = arms(robot, pose[2])
    rx = pose[0] + arm_x - robot.base_x
    ry = pose[1] + arm_y - robot.base_y
    # Law of cosines in the triangle of base joint, elbow and platform joint, with r between base
    # and platform joint: u(theta) = q r + w r', r' = (-ry, rx), where q^2 + w^2 = 1 / r^2.
    inverse = 1.0 / (rx * rx + ry * ry)
    q = (0.5 * robot.per_l1) * (1.0 + (robot.l1 * robot.l1 - robot.l2 * robot.l2) * inverse)
    squared = inverse - q * q
    w = robot.side * np.sqrt(select(squared > 0.0, squared, np.nan))
    ct = q * rx - w * ry
    st = q * ry + w * rx
    cb = (rx - robot.l1 * ct) * robot.per_l2
    sb = (ry - robot.l1 * st) * robot.per_l2
    return posture_of(arm_x, arm_y, ct, st, cb, sb)


@kernel
def out_of_reach(posture: Posture) -> int:
    """0-based index of the first leg that does not reach, else REACHED."""
    missing = posture.ct != posture.ct
    first = select(missing[2], 2, REACHED)
    return select(missing[0], 0, select(missing[1], 1, first))


@kernel
def theta_of(robot: Constants, posture: Posture, pose: Array) -> Array:
    """Actuated angles of a posture at a pose [rad], shape (3,).

    The direction of a leg is counted from the direction to the centre of the base, so theta is
    continuous wherever a platform joint is not straight behind its base joint.
    """
    across = robot.inward_x * posture.st - robot.inward_y * posture.ct
    along = robot.inward_x * posture.ct + robot.inward_y * posture.st
    angle = np.arctan2(across, along)
    # The elbow turns the link by up to pi beyond the platform joint: past (-pi, pi] if both are
    # on the side to which the elbow turns it.
    rx = pose[0] + posture.arm_x - robot.base_x
    ry = pose[1] + posture.arm_y - robot.base_y
    beside = robot.side * (robot.inward_x * ry - robot.inward_y * rx) > 0.0
    beyond = beside & (robot.side * angle < 0.0)
    return robot.inward + select(beyond, angle + 2.0 * math.pi * robot.side, angle)


@kernel
def inverse_kinematics(robot: Constants, pose: Array) -> Legs:
    """Angles of all legs at a pose, shape (3,), in the robot's working mode."""
    posture = posture_at(robot, pose)
    return Legs(
        theta_of(robot, posture, pose),
        np.arctan2(posture.sb, posture.cb),
        np.arctan2(posture.sin_psi, posture.cos_psi),
        out_of_reach(posture),
    )
