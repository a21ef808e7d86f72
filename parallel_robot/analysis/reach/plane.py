"""A plane in the coordinates of a pose: that of a motion, or one that is named."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.paths import plane_of

FLAT = 1e-6  # of its size: what a motion in a plane leaves it by
SPACE = 3
OPTION = '--plane'


class Axis(NamedTuple):
    """An axis of a plane: its direction, a unit vector of shape (m,), its name and its unit."""

    direction: Array
    name: str
    unit: str


class Plane(NamedTuple):
    """A plane through a pose; all coordinates that lie in neither axis are those of the pose.

    Attributes:
        pose: Shape (m,).
        axes: The first axis, which is drawn to the right, and the second one, upward.
    """

    pose: Array
    axes: tuple[Axis, Axis]

    def coordinates(self, poses: Array) -> Array:
        """Both coordinates of poses, shapes (..., 2) and (..., m)."""
        return np.stack([poses @ axis.direction for axis in self.axes], axis=-1)

    def poses(self, coordinates: Array) -> Array:
        """The poses in the plane, shapes (..., m) and (..., 2)."""
        away = coordinates - self.coordinates(self.pose)
        first, second = (axis.direction for axis in self.axes)
        return self.pose + away[..., :1] * first + away[..., 1:] * second

    def beside(self, poses: Array) -> Array:
        """Poses less what of them lies in the plane, of the same shape."""
        return poses - self.poses(self.coordinates(poses))


def plane_of_motion(robot: RobotModel, path: Array) -> Plane:
    """The plane in which a motion lies, through its first pose.

    Of a motion that lies in no plane, or in many, that of two coordinates in which it is longest,
    rather level than upright.

    Args:
        robot: A robot with a place.
        path: Poses of the motion, shape (N, m).
    """
    if robot.planar:
        return Plane(path[0], (_axis(robot, 0), _axis(robot, 1)))
    return _with_normal(robot, path[0], _normal(path[:, :SPACE]))


def named_plane(robot: RobotModel, text: str, pose: Array) -> Plane:
    """A plane by the names of two coordinates, or by its normal.

    Args:
        robot: The robot.
        text: ``x,z`` or, through another place, ``x,z,y=0.1``; or a normal, ``0,1,1``.
        pose: Pose through which it leads, but for what the text says, shape (m,).

    Raises:
        InputError: the text names no plane.
    """
    coordinates = robot.module.coordinates(robot.parameters)
    names = [axis.name for axis in coordinates]
    words = [word.strip() for word in text.split(',')]
    plain = [word for word in words if '=' not in word]
    values = _values([word for word in words if '=' in word], names)
    through = np.array([values.get(name, old) for name, old in zip(names, pose, strict=True)])
    normal = _numbers(plain)
    if normal is not None:
        if len(normal) != SPACE or robot.place != SPACE or not any(normal):
            what = (
                'two coordinates' if robot.place != SPACE else 'two coordinates, or three numbers'
            )
            raise InputError(f'{OPTION} must be {what}, e.g. {names[0]},{names[1]}, not {text}')
        return _with_normal(robot, through, np.array(normal))
    for word in plain:
        if word not in names:
            raise UnknownNameError(OPTION, word, names)
    if len(plain) != 2 or plain[0] == plain[1] or set(plain) & values.keys():
        raise InputError(
            f'{OPTION} must have two coordinates, e.g. {names[0]},{names[1]}, and values of '
            f'others alone, not {text}'
        )
    first, second = (_axis(robot, names.index(word)) for word in plain)
    return Plane(through, (first, second))


def center_of(values: Mapping[str, Any], robot: RobotModel) -> Array | None:
    """Pose at the centre of the motion of a configuration, shape (m,); None if it has none."""
    shape = values['trajectory.shape']
    center = values.get(f'{shape}.center')
    if not isinstance(center, list):
        return None
    if robot.planar:
        center = [*center[:2], values.get(f'{shape}.phi', 0.0)][: robot.pose_size]
    return np.array(center, np.float64) if len(center) == robot.pose_size else None


def _axis(robot: RobotModel, k: int) -> Axis:
    """The axis of one coordinate."""
    coordinate = robot.module.coordinates(robot.parameters)[k]
    return Axis(np.eye(robot.pose_size)[k], coordinate.name, coordinate.unit)


def _with_normal(robot: RobotModel, pose: Array, normal: Array) -> Plane:
    plane = plane_of(OPTION, tuple(pose), 0.0, tuple(normal))
    return Plane(pose, (_along(robot, plane.first), _along(robot, plane.second)))


def _along(robot: RobotModel, direction: Array) -> Axis:
    """The axis of a direction of the place, or its opposite, which points more up than down."""
    largest = int(np.argmax(np.abs(direction)))
    direction = np.copysign(1.0, direction[largest]) * np.round(direction, 12) + 0.0
    if abs(direction[largest]) == 1.0:
        return _axis(robot, largest)
    parts = ', '.join(f'{part:.3g}' for part in direction[:SPACE])
    return Axis(direction, f'along ({parts})', 'm')


def _normal(path: Array) -> Array:
    """Normal of the plane of a path in space, shape (N, 3)."""
    away = path - path.mean(axis=0)
    _, sizes, directions = np.linalg.svd(away, full_matrices=True)
    if sizes[2] <= FLAT * sizes[0] and sizes[1] > FLAT * sizes[0]:
        return np.asarray(directions[2])
    if sizes[1] <= FLAT * sizes[0] and sizes[0] > 0.0:  # a straight line
        line = directions[0]
        upright = abs(line[2]) > math.cos(0.1)
        up = np.eye(3)[1 if upright else 2]
        return np.asarray(up - (up @ line) * line)
    return np.eye(3)[2 - int(np.argmin(np.ptp(path, axis=0)[::-1]))]


def _values(words: list[str], names: list[str]) -> dict[str, float]:
    """What ``name=value`` says."""
    found = {}
    for word in words:
        name, _, value = word.partition('=')
        if name not in names:
            raise UnknownNameError(OPTION, name, names)
        number = _numbers([value])
        if number is None:
            raise InputError(f'{OPTION}: {name} must be a number, not {value}')
        found[name] = number[0]
    return found


def _numbers(words: list[str]) -> list[float] | None:
    try:
        found = [float(word) for word in words]
    except ValueError:
        return None
    return found if all(map(math.isfinite, found)) else None
