"""The arm's equations of motion, linear in a, b, h of its inertia and in the moment w of gravity.

a = I1 + m1 lc1^2 + (m2 + mp) l1^2,  b = I2 + m2 lc2^2 + mp l2^2,  h = l1 (m2 lc2 + mp l2)
w = m1 lc1 + (m2 + mp) l1
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots import planar_links
from parallel_robot_model.robots.contract import Bodies

OTHERS = ('mp',)

NAMES = (
    'a = I1 + m1 lc1^2 + (m2 + mp) l1^2, b = I2 + m2 lc2^2 + mp l2^2, h = l1 (m2 lc2 + mp l2), '
    'w = m1 lc1 + (m2 + mp) l1'
)


def units(robot: Any) -> dict[str, str]:
    """Names with units."""
    return {'a': 'kg m^2', 'b': 'kg m^2', 'h': 'kg m^2', 'w': 'kg m'}


def values(robot: Any) -> Array:
    """a, b, h, w."""
    distal = robot.m2 + robot.mp
    return np.array(
        [
            robot.I1 + robot.m1 * robot.lc1**2 + distal * robot.l1**2,
            robot.I2 + robot.m2 * robot.lc2**2 + robot.mp * robot.l2**2,
            robot.l1 * (robot.m2 * robot.lc2 + robot.mp * robot.l2),
            robot.m1 * robot.lc1 + distal * robot.l1,
        ]
    )


def bodies(robot: Any) -> Bodies:
    """Two links and the payload."""
    l1, l2 = robot.l1, robot.l2
    a, b = {'J1': 1.0, 'm2': l1**2, 'mp': l1**2}, {'J2': 1.0, 'mp': l2**2}
    h, w = {'h2': l1, 'mp': l1 * l2}, {'h1': 1.0, 'm2': l1, 'mp': l1}
    return planar_links.bodies(robot, OTHERS, [a, b, h, w])


def parameters(robot: Any, numbers: Array) -> dict[str, Any]:
    """Masses, inertias and centres of mass."""
    return planar_links.parameters(robot, OTHERS, numbers)


def regressor(
    robot: Any, pose: Array, position: Array, velocity: Array, acceleration: Array
) -> Array:
    """Y at each sample, shape (N, 2, 4); arguments as in LinearModel."""
    first, both = position[:, 0], position.sum(axis=1)
    cosine, sine = np.cos(position[:, 1]), np.sin(position[:, 1])
    rate, rate_2 = velocity.T
    qdd, qdd_2 = acceleration.T
    Y = np.zeros((len(position), 2, 4))
    Y[:, 0, 0] = qdd
    Y[:, :, 1] = (qdd + qdd_2)[:, np.newaxis]
    Y[:, 0, 2] = cosine * (2.0 * qdd + qdd_2) - sine * rate_2 * (2.0 * rate + rate_2)
    Y[:, 1, 2] = cosine * qdd + sine * rate**2
    Y[:, :, 2] += (robot.gravity / robot.l1 * np.cos(both))[:, np.newaxis]
    Y[:, 0, 3] = robot.gravity * np.cos(first)
    return Y
