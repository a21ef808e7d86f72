"""The reference as messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.compiler import cosine, sine
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.layouts import Reader, header_stamp
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
    first, second = robot.axes
    (normal,) = {*'xyz'} - {first, second}
    place = {first: poses[:, 0], second: poses[:, 1]}
    return {**place, f'q{normal}': sine(half), 'qw': cosine(half)}


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


# A new motion as trajectory_msgs/JointTrajectory: the points that a message asks for.

MOST = 1000  # points
MAX_MESSAGE_BYTES = 1 << 20  # bytes of a message that is looked at
ROWS = ('positions', 'velocities', 'accelerations', 'effort')


class Points(NamedTuple):
    """Poses at times."""

    # times since the beginning of the motion [s], increasing, above 0, shape (N,)
    times: NDArray[np.float64]
    pose: NDArray[np.float64]  # poses, shape (N, m)
    # their first derivatives, shape (N, m); None: free, and zero at the last
    rate: NDArray[np.float64] | None
    # their second derivatives, likewise; None if `rate` is
    acceleration: NDArray[np.float64] | None


def read(data: bytes, names: Sequence[str]) -> Points:
    """Read and check a serialised message.

    Args:
        data: The message.
        names: Coordinates of the pose of the robot, in order.

    Raises:
        InputError: it is too long or broken, asks for a time of its own, names other coordinates,
            or its points are too many, incomplete, not finite or not in the order of their times.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise InputError(f'a message of {len(data)} bytes; at most {MAX_MESSAGE_BYTES} are read')
    try:
        given, times, rows = _fields(data)
    except ValueError as error:
        raise InputError(f'a message that cannot be read: {error}') from None
    if header_stamp(data):
        raise InputError('header.stamp must be 0: a motion begins as soon as it can')
    if sorted(given) != sorted(names):
        known = printable(', '.join(given))[:200]
        raise InputError(f'joint_names must be {", ".join(names)}, not {known or "empty"}')
    if not 1 <= len(times) <= MOST:
        raise InputError(f'points must be 1 to {MOST}, not {len(times)}')
    order = [given.index(name) for name in names]
    pose, rate, acceleration, _ = (_matrix(rows, k, len(names), order) for k in range(len(ROWS)))
    if pose is None or (rate is None) != (acceleration is None):
        raise InputError('points must have positions alone, or velocities and accelerations, too')
    steps = np.diff(times, prepend=0.0)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0))
        before = f'{times[k - 1]:.10g} s' if k else 'the beginning at 0 s'
        raise InputError(f'points[{k}].time_from_start = {times[k]:.10g} s is not after {before}')
    if (
        rate is not None
        and acceleration is not None
        and (rate[-1].any() or acceleration[-1].any())
    ):
        raise InputError('the last point must be at rest: its velocities and accelerations 0')
    return Points(times, pose, rate, acceleration)


def _fields(
    data: bytes,
) -> tuple[tuple[str, ...], NDArray[np.float64], list[list[NDArray[np.float64]]]]:
    """Names, times [s] and, for each point, its ROWS."""
    reader = Reader(data)
    reader.header()
    names = reader.texts()
    times, rows = [], []
    for _ in range(reader.number('I')):
        rows.append([reader.numbers() for _ in ROWS])
        times.append(reader.number('i') + reader.number('I') / NANOSECONDS)
    return names, np.array(times), rows


def _matrix(
    rows: list[list[NDArray[np.float64]]], field: int, size: int, order: list[int]
) -> NDArray[np.float64] | None:
    """One field of all points, shape (N, m); None if all of it is empty."""
    values = [row[field] for row in rows]
    if not any(map(len, values)):
        return None
    for k, value in enumerate(values):
        if len(value) != size:
            what = f'points[{k}].{ROWS[field]}'
            raise InputError(f'{what} must be {size} numbers, not {len(value)}')
        if not np.isfinite(value).all():
            raise InputError(f'points[{k}].{ROWS[field]} must be finite, not {value.tolist()}')
    return np.array(values)[:, order]
