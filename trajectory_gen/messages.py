"""The reference as messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parallel_robot_model.messages import layouts, topics
from trajectory_gen.trajectory import Reference


def pose_fields(poses: np.ndarray) -> dict[str, Any]:
    """Fields of geometry_msgs/PoseStamped of poses (x, y, phi) or (x, y), one per row."""
    angle = poses[:, 2] if poses.shape[1] > 2 else np.zeros(len(poses))
    # math, not numpy: its result does not depend on the position of a number in an array
    sine = [math.sin(0.5 * phi) for phi in angle]
    cosine = [math.cos(0.5 * phi) for phi in angle]
    return {'x': poses[:, 0], 'y': poses[:, 1], 'qz': sine, 'qw': cosine}


def pose_messages(stamps: Any, poses: np.ndarray) -> np.ndarray:
    """geometry_msgs/PoseStamped of poses in a plane, see :func:`pose_fields`."""
    return layouts.pose_stamped(topics.FRAME).records(len(poses), stamps, **pose_fields(poses))


def reference_messages(joints: tuple[str, ...], stamps: Any, reference: Reference) -> np.ndarray:
    """trajectory_msgs/JointTrajectory, one point each, of every sample of a reference."""
    return layouts.joint_trajectory(joints).records(
        len(reference.position),
        stamps,
        position=reference.position,
        velocity=reference.velocity,
        acceleration=reference.acceleration,
    )
