"""Configuration of a whole experiment: each group built and checked once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from parallel_robot_base import config
from parallel_robot_base.loop import LoopParameters, validate
from parallel_robot_base.placed import locating
from parallel_robot_control import configuration as control
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.safety import SafetyParameters
from parallel_robot_model.disturbance import DisturbanceParameters
from parallel_robot_model.friction import FrictionParameters
from parallel_robot_model.joint_load import JointLoad
from parallel_robot_model.robots import RobotModel, robot_of
from parallel_robot_sim.imperfections import (
    ActuatorParameters,
    Imperfections,
    LoadParameters,
    SensorParameters,
    imperfections,
)
from parallel_robot_sim.plant import PlantParameters
from trajectory_gen.shapes import shapes_of
from trajectory_gen.trajectory import Trajectory


class PlantConfiguration(NamedTuple):
    """Configuration of the plant.

    Attributes:
        loop: Period, joints and the like.
        robot: True robot.
        parameters: Start, integration and motors.
        load: Friction and disturbance of the actuated joints.
        safety: Gains of the safe action of the motors.
        imperfections: Those of sensors, motors and loads.
    """

    loop: LoopParameters
    robot: RobotModel
    parameters: PlantParameters
    load: JointLoad
    safety: SafetyParameters
    imperfections: Imperfections


class Configuration(NamedTuple):
    """Configuration of an experiment.

    Attributes:
        values: All keys with their plain values, for bags and for people.
        loop: Period, joints, law and the like.
        trajectory: Desired motion on the nominal robot.
        control: Configuration of the controller.
        plant: Configuration of the plant.
    """

    values: Mapping[str, Any]
    loop: LoopParameters
    trajectory: Trajectory
    control: ControlConfiguration
    plant: PlantConfiguration


def configure(values: Mapping[str, Any]) -> Configuration:
    """Build the configuration of an experiment from a resolved one.

    Raises:
        InputError: a value is wrong, even one that is not used.
    """
    for name, shape in shapes_of(values).items():
        config.group(values, shape.Parameters, name)
    with locating(values):
        loop = validate(config.group(values, LoopParameters, ''))
        trajectory = Trajectory(values)
        plant = configure_plant(values)
    return Configuration(values, loop, trajectory, control.configure(values), plant)


def configure_plant(values: Mapping[str, Any]) -> PlantConfiguration:
    """Build the configuration of the plant from a resolved one.

    Raises:
        InputError: a value is wrong.
    """
    loop = validate(config.group(values, LoopParameters, ''))
    return PlantConfiguration(
        loop,
        robot_of(values, 'true_robot'),
        config.group(values, PlantParameters, 'plant'),
        JointLoad(
            config.group(values, FrictionParameters, 'friction'),
            config.group(values, DisturbanceParameters, 'disturbance'),
        ),
        config.group(values, SafetyParameters, 'safety'),
        imperfections(
            loop.seed,
            loop.period,
            config.group(values, SensorParameters, 'sensor'),
            config.group(values, ActuatorParameters, 'actuator'),
            config.group(values, LoadParameters, 'disturbance'),
        ),
    )
