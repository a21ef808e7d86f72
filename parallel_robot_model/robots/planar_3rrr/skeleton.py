"""Links and platform as straight lines, for pictures."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.planar_3rrr.parameters import RobotParameters


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
