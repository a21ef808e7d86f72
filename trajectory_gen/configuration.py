"""From a configuration to the desired motion of its robot."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from parallel_robot_base import config, fields
from parallel_robot_base.errors import UnknownNameError
from parallel_robot_base.groups import Declared, Groups, build
from parallel_robot_base.loop import loop_of
from parallel_robot_base.placed import locating
from parallel_robot_model.configuration import robot_defaults
from parallel_robot_model.contract import Robot
from parallel_robot_model.robots import RobotModel, module_of, robot_with
from trajectory_gen.shapes import Shape, custom_trajectories, shapes
from trajectory_gen.trajectory import Trajectory, TrajectoryParameters


def of_shapes(shapes: Mapping[str, Shape]) -> Declared:
    """Groups of some shapes."""
    for name, shape in shapes.items():
        yield name, shape.Parameters


def declared(robot: Robot, shapes: Mapping[str, Shape]) -> Declared:
    """Groups of the motion and of all its shapes."""
    yield 'trajectory', TrajectoryParameters
    yield 'trajectory', robot.MotionLimits
    yield from of_shapes(shapes)


def trajectory_of(values: Mapping[str, Any]) -> Trajectory:
    """The desired motion of a resolved configuration.

    Raises:
        InputError: a value is wrong, even one of a shape that is not used.
    """
    loop = loop_of(values)
    with locating(values):
        robot, known = module_of(loop), shapes(loop.custom_trajectories)
        groups = build(values, [('robot', robot.Parameters), *declared(robot, known)])
        return trajectory_from(
            groups, robot_with(loop, groups.at('robot', robot.Parameters)), known
        )


def trajectory_from(groups: Groups, robot: RobotModel, shapes: Mapping[str, Shape]) -> Trajectory:
    """The desired motion of a robot.

    Raises:
        UnknownNameError: no such shape.
        InputError: the shape refuses its parameters, or does not suit the robot.
    """
    parameters = groups[TrajectoryParameters]
    name = parameters.shape
    if name not in shapes:
        raise UnknownNameError('trajectory.shape', name, shapes, 'trajectory.shape')
    limits, shape = groups[robot.module.MotionLimits], shapes[name]
    known: Any = shape  # a module, which is hashable
    return _trajectory(robot, parameters, limits, known, groups.at(name, shape.Parameters))


@functools.lru_cache(maxsize=4)  # the runs of a study share them
def _trajectory(*given: Any) -> Trajectory:
    return Trajectory(*given)


def robot_and_shape_defaults(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults by key of the custom robot and the custom trajectories of a configuration."""
    found: dict[str, Any] = {}
    for name, shape in custom_trajectories(values['custom_trajectories']).items():
        found |= fields.defaults(shape.Parameters, f'{name}.')
    return found | robot_defaults(values)


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of custom robot and trajectories; see `config.resolve`.

    Gains of custom laws are left as they are: their files are not loaded.
    """
    return config.resolve(scenario, overrides, robot_and_shape_defaults)
