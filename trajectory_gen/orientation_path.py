"""Points with quaternions as poses of a robot, whose orientations are rotation vectors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms import spatial
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.paths import length_of

KEY = 'waypoints.space'
AXES = ('x', 'y', 'z', 'rx', 'ry', 'rz')
NUMBERS = 7  # of a point


def as_poses(robot: RobotModel, numbers: Sequence[float]) -> tuple[float, ...]:
    """Poses with the rotation vectors of the tool from home, which go on without a jump.

    Of a rotation that can be told by several vectors, the one nearest to that of the point before
    is taken: between two points the tool turns by less than half a turn.

    Args:
        robot: The robot.
        numbers: x, y, z [m] and the quaternion x, y, z, w of the tool in the world, point after
            point.

    Raises:
        InputError: the robot has no such poses, or a point is none.
    """
    axes = tuple(axis.name for axis in robot.module.coordinates(robot.parameters))
    orientations = getattr(robot.module, 'orientations', None)
    if axes != AXES or orientations is None:
        raise InputError(
            f'quaternions need a pose of {", ".join(AXES)}; that of {robot.name} is '
            f'{", ".join(axes)}',
            KEY,
        )
    if len(numbers) % NUMBERS:
        what = f'x, y, z and a quaternion for each point, not {len(numbers)} numbers'
        raise InputError(f'waypoints.points must hold {what}', 'waypoints.points')
    points = np.reshape(numbers, (-1, NUMBERS))
    if not points[:, 3:].any(axis=1).all():
        raise InputError('a quaternion in waypoints.points is zero', 'waypoints.points')
    home = orientations(robot.parameters, np.zeros((1, len(AXES))))
    back = home * np.array([-1.0, -1.0, -1.0, 1.0])
    turned = spatial.vectors_of_quaternions(spatial.quaternion_product(points[:, 3:], back))
    return tuple(np.hstack([points[:, :3], continuous(turned)]).ravel().tolist())


def continuous(vectors: Array) -> Array:
    """Rotation vectors of the same rotations, each the nearest to the one before, shape (N, 3)."""
    made = vectors.copy()
    for k in range(1, len(made)):
        before, now = made[k - 1], vectors[k]
        angle = length_of(now)
        # Near no rotation, the axis is that of the vector before.
        axis = now / angle if angle > 1e-9 else before / max(length_of(before), 1e-9)
        turns = round((float(before @ axis) - angle) / (2.0 * math.pi))
        made[k] = now + 2.0 * math.pi * turns * axis
    return made
