"""The groups in which the parameters of an experiment are declared, by title and prefix."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from parallel_robot_base.fields import Parameter, parameters
from parallel_robot_base.loop import LoopParameters
from parallel_robot_control.approach import ApproachParameters
from parallel_robot_control.configuration import ControllerParameters
from parallel_robot_control.contract import Law
from parallel_robot_control.delay_identification import LockInParameters
from parallel_robot_control.estimator import EstimatorParameters
from parallel_robot_control.safety import SafetyParameters
from parallel_robot_model.contract import Robot
from parallel_robot_model.disturbance import DisturbanceParameters
from parallel_robot_model.friction import FrictionParameters
from parallel_robot_sim.imperfections import (
    ActuatorParameters,
    LoadParameters,
    SensorParameters,
)
from parallel_robot_sim.plant import PlantParameters
from trajectory_gen.shapes import SHAPES, Shape
from trajectory_gen.trajectory import TrajectoryParameters


def groups(
    robot: Robot, laws: Mapping[str, Law], shapes: Mapping[str, Shape] = SHAPES
) -> dict[str, dict[str, Any]]:
    """Groups of all parameters but those of recorder and monitor, by title and prefix.

    Args:
        robot: Module of the robot.
        laws: The laws by name.
        shapes: The shapes of motions by name.
    """
    return {
        'The loop': {'': LoopParameters},
        'Robot; `true_robot.*`, the simulated one, has the same keys and follows it': {
            'robot': robot.Parameters
        },
        'Motion': {'trajectory': TrajectoryParameters},
        'What the motion must spare this robot': {'trajectory': robot.MotionLimits},
        'Shapes of the motion': {name: shape.Parameters for name, shape in shapes.items()},
        'Controller': {
            'controller': ControllerParameters,
            'estimator': EstimatorParameters,
            'lock_in': LockInParameters,
            'approach': ApproachParameters,
            'safety': SafetyParameters,
        },
        'What is a fault of this robot': {'safety': robot.SafetyMargins},
        'Laws': {name: law.Gains for name, law in laws.items()},
        'Plant': {
            'plant': PlantParameters,
            'friction': FrictionParameters,
            'disturbance': DisturbanceParameters,
        },
        'Imperfections of the plant': {
            'sensor': SensorParameters,
            'actuator': ActuatorParameters,
            'disturbance': LoadParameters,
        },
    }


def members(
    robot: Robot, laws: Mapping[str, Law], shapes: Mapping[str, Shape] = SHAPES
) -> list[tuple[str, Parameter]]:
    """Key and description of all these parameters, and of those of the true robot.

    Args:
        robot: Module of the robot.
        laws: The laws by name.
        shapes: The shapes of motions by name.
    """
    pairs = [pair for part in groups(robot, laws, shapes).values() for pair in part.items()]
    return [
        (f'{prefix}.{parameter.key}' if prefix else parameter.key, parameter)
        for prefix, group in [*pairs, ('true_robot', robot.Parameters)]
        for parameter in parameters(group)
    ]
