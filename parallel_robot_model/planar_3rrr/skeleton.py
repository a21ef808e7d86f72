"""Points of the robot, for pictures of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.planar_3rrr.kinematics import Array
from parallel_robot_model.planar_3rrr.parameters import RobotParameters


class Skeleton(NamedTuple):
    """Ends of the links.

    Attributes:
        base: Base joints [m], shape (3, 2).
        elbow: Between proximal and distal link [m], shape (..., 3, 2).
        platform: Joints of the platform [m], shape (..., 3, 2).
    """

    base: Array
    elbow: Array
    platform: Array


def skeleton(robot: RobotParameters, pose: Array, theta: Array) -> Skeleton:
    """Points of the robot in one posture or in many.

    Args:
        robot: The robot.
        pose: Of the platform [m, m, rad], shape (..., 3).
        theta: Actuated angles [rad], shape (..., 3).
    """
    base = np.stack([robot.base_x, robot.base_y], axis=1)
    angle = pose[..., 2:] + np.array(robot.platform_angle)
    centre = pose[..., np.newaxis, :2]
    return Skeleton(base, base + robot.l1 * _unit(theta), centre + robot.l3 * _unit(angle))


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
