"""The groups in which the parameters of an experiment are declared, by title."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from parallel_robot_control import configuration as control
from parallel_robot_control.contract import Law
from parallel_robot_model.configuration.fields import Parameter, parameters
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.robots import registry
from parallel_robot_model.robots.contract import Robot
from parallel_robot_sim.configuration import DECLARED
from trajectory_gen import configuration
from trajectory_gen.shapes import SHAPES, Shape


def groups(
    robot: Robot, laws: Mapping[str, Law], shapes: Mapping[str, Shape] = SHAPES
) -> dict[str, list[tuple[str, Any]]]:
    """Groups of all parameters but those of recorder and monitor, by prefix and type, by title.

    Args:
        robot: Module of the robot.
        laws: The laws by name.
        shapes: The shapes of motions by name.
    """
    return {
        'The loop': [('', LoopParameters)],
        'Robots and loads; `true_robot.*`, the simulated one, follows `robot.*`': [
            *registry.declared_groups(robot)
        ],
        'Motion': [*configuration.declared(robot, {})],
        'Shapes of the motion': [*configuration.of_shapes(shapes)],
        'Controller': [*control.declared(robot, {})],
        'Laws': [*control.of_laws(laws)],
        'Plant, sensors and motors': [*DECLARED],
    }


def members(
    robot: Robot, laws: Mapping[str, Law], shapes: Mapping[str, Shape] = SHAPES
) -> list[tuple[str, Parameter]]:
    """Key and description of all these parameters.

    Args:
        robot: Module of the robot.
        laws: The laws by name.
        shapes: The shapes of motions by name.
    """
    return [
        (f'{prefix}.{parameter.key}' if prefix else parameter.key, parameter)
        for part in groups(robot, laws, shapes).values()
        for prefix, group in part
        for parameter in parameters(group)
    ]
