"""A plane of a robot's pose, and what of it the tool reaches."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis.report.looks import posture
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import REACHED, Reach
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.paths import plane_of
from trajectory_gen.trajectory import joints_at

FLAT = 1e-6  # of its size: what a motion in a plane leaves it by
SPACE = 3


class Axis(NamedTuple):
    """An axis of a plane: its direction, a unit vector of shape (m,), and its name."""

    direction: Array
    name: str


class Plane(NamedTuple):
    """A plane through a pose; all coordinates that lie in neither axis are those of the pose."""

    pose: Array  # shape (m,)
    # the first axis, which is drawn to the right, and the second one, upward
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


def _axis(robot: RobotModel, k: int) -> Axis:
    """The axis of one coordinate."""
    coordinate = robot.module.coordinates(robot.parameters)[k]
    return Axis(np.eye(robot.pose_size)[k], coordinate.name)


def _with_normal(robot: RobotModel, pose: Array, normal: Array) -> Plane:
    plane = plane_of('', tuple(pose), 0.0, tuple(normal))
    return Plane(pose, (_along(robot, plane.first), _along(robot, plane.second)))


def _along(robot: RobotModel, direction: Array) -> Axis:
    """The axis of a direction of the place, or its opposite, which points more up than down."""
    largest = int(np.argmax(np.abs(direction)))
    direction = np.copysign(1.0, direction[largest]) * np.round(direction, 12) + 0.0
    if abs(direction[largest]) == 1.0:
        return _axis(robot, largest)
    parts = ', '.join(f'{part:.3g}' for part in direction[:SPACE])
    return Axis(direction, f'along ({parts})')


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


# What of a plane the tool of a robot reaches, found from one pose by its neighbours.

COARSE, FINE = 80, 320  # steps of a grid on its longer side, to look for the region, to show it
FEW = 20  # steps of a region that is too small for its grid
TRIES = 6  # grids at most, each wider than the one before
MORE = 0.2  # of a width, by which a window that is too narrow becomes wider


class Region(NamedTuple):
    """What a robot reaches in a plane; rows go with the second axis, columns with the first."""

    plane: Plane
    first: Array  # m, coordinates along the first axis, shape (columns,)
    second: Array  # m, coordinates along the second axis, shape (rows,)
    reach: Reach  # what is reached of them
    complete: bool  # whether the region ends within the grid

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which poses are reached with all joints in their travel, shape (rows, columns)."""
        return self.reach.travel_left >= 0.0

    @property
    def area(self) -> float:
        """Area of the region [m^2]."""
        steps = (float(np.diff(axes).mean()) for axes in (self.first, self.second))
        return math.prod(steps) * int(self.inside.sum())

    @property
    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and largest coordinate of the region along both axes [m]."""
        inside = self.inside
        along = (self.first[inside.any(axis=0)], self.second[inside.any(axis=1)])
        return tuple((float(each[0]), float(each[-1])) for each in along)  # type: ignore[return-value]


def region_of(robot: RobotModel, plane: Plane, steps: int = FINE) -> Region:
    """What a robot reaches in a plane.

    Found from the pose of the plane by neighbours of a grid, in whose every pose margins have the
    signs that they have there, and joints are within their travel.

    Args:
        robot: A robot with a place.
        plane: The plane.
        steps: Of the grid, on the longer side of the region.

    Raises:
        InputError: the robot does not reach the pose of the plane.
    """
    here = plane.coordinates(plane.pose)
    size = _first_size(robot, plane.pose)
    window = np.stack([here - size, here + size])
    for _ in range(TRIES):
        region = _on_grid(robot, plane, window, COARSE)
        wider = _wider(region, window, 1.0)
        if (wider != window).any():
            window = wider
        elif (np.ptp(region.extent, axis=1) / _steps(region)).max() < FEW:
            window = _cropped(region)
        else:
            break
    window = _cropped(region)
    for _ in range(TRIES):  # what is narrower than a step of the coarse grid
        region = _on_grid(robot, plane, window, steps)
        wider = _wider(region, window, MORE)
        if (wider == window).all():
            break
        window = wider
    return region


def _first_size(robot: RobotModel, pose: Array) -> float:
    """Half the width of the first grid: the size of the robot."""
    joints = joints_at(robot, pose[np.newaxis])
    if joints.out_of_reach[0] != REACHED:
        raise _beyond(robot, pose)
    ends = [ends for ends in posture(robot, pose, joints.position[0]).values() if ends.size]
    if not ends:
        return 1.0
    points = np.concatenate([each.reshape(-1, each.shape[-1]) for each in ends])
    return float(np.ptp(points, axis=0).max()) or 1.0


def _beyond(robot: RobotModel, pose: Array) -> InputError:
    values = ', '.join(f'{value:.6g}' for value in pose)
    return InputError(f'{robot.name} does not reach [{values}] from home')


def _on_grid(robot: RobotModel, plane: Plane, window: Array, steps: int) -> Region:
    """What is reached in a window, shape (2, 2), of which the pose of the plane is a node."""
    here = plane.coordinates(plane.pose)
    step = np.ptp(window, axis=0).max() / steps
    low = np.ceil((here - window[0]) / step).astype(int)
    high = np.ceil((window[1] - here) / step).astype(int)
    first, second = (here[k] + step * np.arange(-low[k], high[k] + 1) for k in range(2))
    poses = plane.poses(np.stack(np.meshgrid(first, second), axis=-1))
    reach = _traced(robot, poses, (int(low[1]), int(low[0])))
    inside = reach.travel_left >= 0.0
    if not inside[low[1], low[0]]:
        raise _beyond(robot, plane.pose)
    complete = not (inside[:, [0, -1]].any() or inside[[0, -1]].any())
    return Region(plane, first, second, reach, complete)


def _traced(robot: RobotModel, poses: Array, first: tuple[int, int]) -> Reach:
    if robot.module.trace is not None:
        return robot.module.trace(robot.parameters, poses, first)
    return _connected(robot, poses, first)


def _connected(robot: RobotModel, poses: Array, first: tuple[int, int]) -> Reach:
    """What is reached by a robot whose joints follow from the pose alone.

    It is a connected set of poses whose margins all have the signs that they have at the first.
    """
    from scipy.ndimage import label  # it takes long to load

    shape, module = poses.shape[:2], robot.module
    reference = joints_at(robot, poses.reshape(-1, poses.shape[-1]))
    with np.errstate(invalid='ignore'):  # where it does not reach
        given = module.margins(robot.parameters, reference)
    known = (reference.out_of_reach == REACHED).reshape(shape)
    margins = [each._replace(values=each.values.reshape(shape)) for each in given]
    for each in margins:
        known &= np.sign(each.values) == np.sign(each.values[first])
    parts, _ = label(known)
    inside = (parts == parts[first]) & known
    return Reach(
        tuple(
            each._replace(values=np.where(inside, np.abs(each.values), np.nan)) for each in margins
        ),
        np.where(inside, np.inf, np.nan),
    )


def _wider(region: Region, window: Array, share: float) -> Array:
    """The window, wider by a share of itself where the region touches a side."""
    inside, wider = region.inside, window.copy()
    width = np.ptp(window, axis=0)
    touched = ((inside[:, 0], inside[0]), (inside[:, -1], inside[-1]))
    for side, sign in ((0, -1.0), (1, 1.0)):
        for k in range(2):
            if touched[side][k].any():
                wider[side, k] += sign * share * width[k]
    return wider


def _cropped(region: Region) -> Array:
    """A window around the region, wider by two steps of its grid."""
    (low, high), steps = np.transpose(region.extent), _steps(region)
    return np.stack([low - 2.0 * steps, high + 2.0 * steps])


def _steps(region: Region) -> Array:
    return np.array([region.first[1] - region.first[0], region.second[1] - region.second[0]])
