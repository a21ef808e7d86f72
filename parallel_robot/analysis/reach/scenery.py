"""What is drawn with a region: the motion of its scenario, the robot, home."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis.reach.plane import Plane, center_of, named_plane, plane_of_motion
from parallel_robot.analysis.report.labels import label
from parallel_robot.analysis.report.space_views import posture
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import REACHED, Coordinate
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import Configuration
from trajectory_gen import preflight
from trajectory_gen.trajectory import joints_at


class Scenery(NamedTuple):
    """What is drawn with a region.

    Attributes:
        title: Of the picture, and in a second line what is smaller.
        robot: The robot.
        coordinates: Of its pose.
        home: Pose where it is traced from, shape (m,); None where that does not matter.
        path: Poses of the motion, shape (N, m).
        lines: Lines of the robot in the plane [m], shape (lines, 2, 2); of a robot in space none.
        values: The resolved configuration, which has the limits of the margins.
    """

    title: str
    robot: RobotModel
    coordinates: tuple[Coordinate, ...]
    home: Array | None
    path: Array
    lines: Array
    values: Mapping[str, Any]


def plane_and_scenery(configuration: Configuration, plane: str = '') -> tuple[Plane, Scenery]:
    """The plane of a scenario, and what is drawn with what is reached in it.

    Args:
        configuration: The scenario.
        plane: The plane, see :func:`named_plane`; empty: that of the motion.

    Raises:
        InputError: the pose of the robot has no place, or the text names no plane.
    """
    trajectory, values = configuration.trajectory, configuration.values
    robot = trajectory.robot
    module: Any = robot.module
    coordinates = module.coordinates(robot.parameters)
    if not robot.place:
        names = ', '.join(axis.name for axis in coordinates)
        raise InputError(f'the pose of {robot.name} is no place: {names}; it has no workspace')
    path = trajectory.poses(preflight.grid(trajectory, configuration.loop.period)).pose
    home = module.home(robot.parameters) if hasattr(module, 'home') else None
    if plane:
        center = center_of(values, robot)
        chosen = named_plane(robot, plane, _reached(robot, center, path[0], home))
    else:
        start = _reached(robot, path[0], home)
        chosen = plane_of_motion(robot, path)._replace(pose=start)
    title = _title(configuration.loop.scenario, chosen, coordinates)
    lines = _lines(robot, chosen)
    return chosen, Scenery(title, robot, coordinates, home, path, lines, values)


def _reached(robot: RobotModel, *poses: Array | None) -> Array:
    """The first of some poses that the robot reaches; the last one where it reaches none."""
    known = [pose for pose in poses if pose is not None]
    reached = (
        pose for pose in known if joints_at(robot, pose[np.newaxis]).out_of_reach[0] == REACHED
    )
    return next(reached, known[-1])


def _lines(robot: RobotModel, plane: Plane) -> Array:
    """The robot at the pose of a plane in which it moves as a whole."""
    joints = joints_at(robot, plane.pose[np.newaxis])
    in_place = [np.flatnonzero(axis.direction).tolist() for axis in plane.axes] == [[0], [1]]
    if not (robot.planar and in_place) or joints.out_of_reach[0] != REACHED:
        return np.zeros((0, 2, 2))
    return np.concatenate(list(posture(robot, plane.pose, joints.position[0]).values()))


def _title(scenario: str, plane: Plane, coordinates: tuple[Coordinate, ...]) -> str:
    """The scenario, and those coordinates that are the same in all the plane."""
    used = sum(np.abs(axis.direction) for axis in plane.axes)
    fixed = [
        f'{axis.name} = {round(float(value), 9) + 0.0:.4g} {axis.unit}'
        for axis, value, share in zip(coordinates, plane.pose, np.asarray(used), strict=True)
        if share == 0.0
    ]
    return f'{label(scenario)}: reach of the tool\n' + (f'at {", ".join(fixed)}' if fixed else '')
