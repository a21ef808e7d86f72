"""Parameters of the robot, what follows from them, its inverse kinematics, and its lines."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import arctangent, cosine, kernel, select, sine, vector
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import REACHED
from parallel_robot_model.robots.link import check_links

# Parameters of the robot, and the conditions that they must meet.


class RobotParameters(NamedTuple):
    """Geometry and inertia of a 3-RRR robot with three equal legs.

    Source:
        Doan, Le, Vo (2019), Table 1; base points and platform angles from the same group's public
        model of the robot.
    """

    l1: Annotated[float, Field('m', 'length of the proximal (actuated) link')]
    l2: Annotated[float, Field('m', 'length of the distal link')]
    l3: Annotated[float, Field('m', 'radius from the platform centre to its joints')]
    lc1: Annotated[float, Field('m', 'actuated joint to the centre of mass of the proximal link')]
    lc2: Annotated[float, Field('m', 'elbow to the centre of mass of the distal link')]
    m1: Annotated[float, Field('kg', 'mass of a proximal link')]
    m2: Annotated[float, Field('kg', 'mass of a distal link')]
    mp: Annotated[float, Field('kg', 'mass of the platform')]
    I1: Annotated[float, Field('kg m^2', 'inertia of a proximal link about its centre of mass')]
    I2: Annotated[float, Field('kg m^2', 'inertia of a distal link about its centre of mass')]
    Ip: Annotated[float, Field('kg m^2', 'inertia of the platform about its centre')]
    base_x: Annotated[tuple[float, float, float], Field('m', 'x of the base joints')]
    base_y: Annotated[tuple[float, float, float], Field('m', 'y of the base joints')]
    platform_angle: Annotated[
        tuple[float, float, float], Field('rad', 'direction of the platform joints at phi = 0')
    ]
    working_mode: Annotated[
        tuple[float, float, float], Field('', 'side of the elbow of each leg, +1 or -1')
    ]


def validate(robot: RobotParameters, name: str = 'robot') -> RobotParameters:
    """Return `robot` if it can be built.

    Raises:
        RobotError: a length, mass or inertia is not positive; a centre of mass lies outside its
            link; two base joints coincide or are too far apart for the legs and the platform; a
            working mode is neither +1 nor -1.
    """
    check_links(robot, ('l1', 'l2', 'l3', 'm1', 'm2', 'mp', 'I1', 'I2', 'Ip'), name)
    for mode in robot.working_mode:
        if mode not in (-1.0, 1.0):
            key = f'{name}.working_mode'
            raise RobotError(f'{key} must hold +1 or -1, not {mode:g}', key)
    base = list(zip(robot.base_x, robot.base_y, strict=True))
    for (i, a), (j, b) in combinations(enumerate(base, start=1), 2):
        if math.dist(a, b) < 1e-6:  # m
            raise RobotError(f'{name}: base joints {i} and {j} stand on the same spot', name)
        # Legs i and j and the platform between them must be able to span the base.
        reach = 2.0 * (robot.l1 + robot.l2) + 2.0 * robot.l3
        if math.dist(a, b) >= reach:
            raise RobotError(
                f'{name}: base joints {i} and {j} are {math.dist(a, b):g} m apart, the legs and '
                f'the platform span only {reach:g} m',
                name,
            )
    return robot


# What the kernels take of the robot: its parameters, with all that follows from them alone.


class Constants(NamedTuple):
    """Geometry and inertia; of the vectors, each of shape (3,), an element belongs to a leg."""

    l1: float  # length of a proximal link [m]
    l2: float  # length of a distal link [m]
    per_l1: float  # 1 / l1 [1/m]; to multiply takes less time than to divide
    per_l2: float  # 1 / l2 [1/m]
    per_l3: float  # 1 / l3 [1/m]
    l3: float  # radius of the platform joints [m]
    a: float  # inertia I1 + m1 lc1^2 + m2 l1^2 of a leg by theta alone [kg m^2]
    b: float  # inertia I2 + m2 lc2^2 of a leg by beta alone [kg m^2]
    h: float  # coupling m2 l1 lc2 of both [kg m^2]
    mp: float  # mass of the platform [kg]
    Ip: float  # inertia of the platform [kg m^2]
    base_x: Array  # x of the base joints [m]
    base_y: Array  # y of the base joints [m]
    joint_x: Array  # x of the platform joints from its centre at phi = 0 [m]
    joint_y: Array  # y of the same [m]
    inward_x: Array  # cos of the direction from a base joint to the centre of the base
    inward_y: Array  # sin of the same
    inward: Array  # that direction [rad]
    side: Array  # working mode: +1 or -1


def constants(robot: RobotParameters) -> Constants:
    """Constants of a robot."""
    base_x, base_y = np.array(robot.base_x), np.array(robot.base_y)
    angle = np.array(robot.platform_angle)
    x, y = base_x.mean() - base_x, base_y.mean() - base_y
    x[(x == 0.0) & (y == 0.0)] = 1.0
    inward = arctangent(y, x)
    return Constants(
        robot.l1,
        robot.l2,
        1.0 / robot.l1,
        1.0 / robot.l2,
        1.0 / robot.l3,
        robot.l3,
        robot.I1 + robot.m1 * robot.lc1**2 + robot.m2 * robot.l1**2,
        robot.I2 + robot.m2 * robot.lc2**2,
        robot.m2 * robot.l1 * robot.lc2,
        robot.mp,
        robot.Ip,
        vector(base_x),
        vector(base_y),
        vector(robot.l3 * cosine(angle)),
        vector(robot.l3 * sine(angle)),
        vector(cosine(inward)),
        vector(sine(inward)),
        vector(inward),
        vector(robot.working_mode),
    )


# Inverse kinematics: the directions of all links at a pose, and their angles.
#
# Loop closure of leg i, with u(a) = (cos a, sin a), base joint A_i, elbow E_i = A_i + l1
# u(theta_i):
#
#     P + l3 u(phi + gamma_i) = A_i + l1 u(theta_i) + l2 u(beta_i)
#
# The pose is (x, y, phi) [m, m, rad]; theta_i is the actuated and beta_i the distal angle, both
# absolute [rad]; the passive joint is psi_i = beta_i - theta_i. Links are unit vectors as long as
# possible: angles are only computed where they go out. A vector of shape (3,) has an element for
# each leg.


class Posture(NamedTuple):
    """Directions of the links, each shape (3,); NaN for a leg that does not reach."""

    arm_x: Array  # platform centre to the platform joint, x [m]
    arm_y: Array  # the same, y [m]
    ct: Array  # cos theta
    st: Array  # sin theta
    cb: Array  # cos beta
    sb: Array  # sin beta
    cos_psi: Array
    sin_psi: Array


class Legs(NamedTuple):
    """Angles of the three legs at a pose."""

    theta: Array  # actuated angles [rad], shape (3,)
    beta: Array  # absolute angles of the distal links in (-pi, pi] [rad], shape (3,)
    psi: Array  # passive joints in (-pi, pi] [rad], shape (3,)
    out_of_reach: int  # 0-based index of the first leg that does not reach, else REACHED


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


# Links and platform as straight lines, for pictures.


def segments(robot: RobotParameters, pose: Array, theta: Array) -> dict[str, Array]:
    """Lines of the robot in one posture or in many, by the name of their part.

    Args:
        robot: The robot.
        pose: Pose of the platform [m, m, rad], shape (..., 3).
        theta: Actuated angles [rad], shape (..., 3).

    Returns:
        Ends of three proximal links, three distal links and three sides of the platform [m], each
        shape (..., 3, 2, 2).
    """
    elbow = np.stack([robot.base_x, robot.base_y], axis=1) + robot.l1 * _unit(theta)
    base = np.broadcast_to(np.stack([robot.base_x, robot.base_y], axis=1), elbow.shape)
    angle = pose[..., 2:] + np.array(robot.platform_angle)
    joint = pose[..., np.newaxis, :2] + robot.l3 * _unit(angle)
    ends = {
        'proximal': (base, elbow),
        'distal': (elbow, joint),
        'platform': (joint, np.roll(joint, -1, axis=-2)),
    }
    return {part: np.stack(pair, axis=-2) for part, pair in ends.items()}


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
