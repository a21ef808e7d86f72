"""How the place of the end effector follows from the joints, for laws that ask for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_control.contract import Law
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, multiply, select
from parallel_robot_model.robots.contract import FOUND
from parallel_robot_model.robots.registry import RobotModel

STEP = 1e-5  # rad or m, of a difference
NO_PLACE = -1  # of a law that does not ask


def asked_of(law: Law, robot: RobotModel) -> int:
    """Number of the coordinates of the place, 0 to 3, that a law asks for; or NO_PLACE."""
    return robot.place if getattr(law, 'PLACE', False) else NO_PLACE  # optional in the contract


@inner
def place_gradient(locate: Any, robot: Any, place: int, position: Array, pose: Array) -> Array:
    """A^T A, A the derivative of the place by the joints, shape (n, n).

    By central differences of the forward kinematics, which every robot has. Where there is no
    place, or none beside the present one, all joints are to be held: the identity.

    Args:
        locate: Forward kinematics, see Robot.locate.
        robot: Constants of the robot.
        place: Number of the first coordinates of a pose that are the place.
        position: Joints [rad or m], shape (n,).
        pose: Their pose, shape (m,).
    """
    zero = np.zeros_like(position)
    one = np.diag(zero + 1.0)
    x, y, z = zero, zero, zero
    if place == 0:
        return one
    for j in range(len(position)):
        ahead = locate(robot, position + STEP * one[j], pose)
        back = locate(robot, position - STEP * one[j], pose)
        if ahead.fault != FOUND or back.fault != FOUND:
            return one
        slope = (ahead.pose - back.pose) / (2.0 * STEP)
        for k in range(place):
            share = slope[k] * one[j]
            x = x + select(k == 0, share, zero)
            y = y + select(k == 1, share, zero)
            z = z + select(k == 2, share, zero)
    return _outer(x) + _outer(y) + _outer(z)


@inner
def _outer(a: Array) -> Array:
    """a a^T."""
    diagonal = np.diag(a)
    return multiply(multiply(diagonal, np.zeros_like(diagonal) + 1.0), diagonal)
