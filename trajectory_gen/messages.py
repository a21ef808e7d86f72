"""The reference as messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.compiler import cosine, sine
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.trajectory import Reference


def pose_fields(robot: RobotModel, poses: np.ndarray) -> dict[str, Any]:
    """Fields of geometry_msgs/PoseStamped of poses that are places, one per row."""
    if not robot.planar:
        module: Any = robot.module
        turned = module.orientations(robot.parameters, poses)
        names = ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')
        return dict(zip(names, (*poses[:, :3].T, *turned.T), strict=True))
    angle = poses[:, 2] if poses.shape[1] > 2 else np.zeros(len(poses))
    half = 0.5 * np.asarray(angle)  # a vector would have machine code of its own
    return {'x': poses[:, 0], 'y': poses[:, 1], 'qz': sine(half), 'qw': cosine(half)}


def pose_messages(robot: RobotModel, stamps: Any, poses: np.ndarray) -> np.ndarray:
    """geometry_msgs/PoseStamped of poses that are places, see :func:`pose_fields`."""
    fields = pose_fields(robot, poses)
    return layouts.pose_stamped(topics.FRAME).records(len(poses), stamps, **fields)


def reference_messages(joints: tuple[str, ...], stamps: Any, reference: Reference) -> np.ndarray:
    """trajectory_msgs/JointTrajectory, one point each, of every sample of a reference."""
    return layouts.joint_trajectory(joints).records(
        len(reference.position),
        stamps,
        position=reference.position,
        velocity=reference.velocity,
        acceleration=reference.acceleration,
    )
