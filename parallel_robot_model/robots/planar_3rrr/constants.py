"""What the kernels take of the robot: its parameters, with all that follows from them alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import arctangent, cosine, sine, vector
from parallel_robot_model.robots.planar_3rrr.parameters import RobotParameters


class Constants(NamedTuple):
    """Geometry and inertia; of the vectors, each of shape (3,), an element belongs to a leg.

    Attributes:
        l1: Length of a proximal link [m].
        l2: Length of a distal link [m].
        per_l1: 1 / l1 [1/m]; to multiply takes less time than to divide.
        per_l2: 1 / l2 [1/m].
        per_l3: 1 / l3 [1/m].
        l3: Radius of the platform joints [m].
        a: Inertia I1 + m1 lc1^2 + m2 l1^2 of a leg by theta alone [kg m^2].
        b: Inertia I2 + m2 lc2^2 of a leg by beta alone [kg m^2].
        h: Coupling m2 l1 lc2 of both [kg m^2].
        mp: Mass of the platform [kg].
        Ip: Inertia of the platform [kg m^2].
        base_x: x of the base joints [m].
        base_y: y of the base joints [m].
        joint_x: x of the platform joints from its centre at phi = 0 [m].
        joint_y: y of the same [m].
        inward_x: cos of the direction from a base joint to the centre of the base.
        inward_y: sin of the same.
        inward: That direction [rad].
        side: Working mode: +1 or -1.
    """

    l1: float
    l2: float
    per_l1: float
    per_l2: float
    per_l3: float
    l3: float
    a: float
    b: float
    h: float
    mp: float
    Ip: float
    base_x: Array
    base_y: Array
    joint_x: Array
    joint_y: Array
    inward_x: Array
    inward_y: Array
    inward: Array
    side: Array


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
