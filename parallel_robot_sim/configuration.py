"""From a configuration to a whole experiment: motion, controller and plant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from parallel_robot_control import configuration as control
from parallel_robot_control.configuration import ControlConfiguration, ControllerParameters
from parallel_robot_control.safety.limiting import SafetyParameters
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import Declared, Groups, build_groups
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.configuration.plain_data import locating
from parallel_robot_model.robots import registry
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
)
from parallel_robot_model.robots.registry import RobotModel, module_of, robot_with
from parallel_robot_sim.imperfections import (
    ActuatorParameters,
    ComplianceParameters,
    Imperfections,
    LoadParameters,
    SensorParameters,
    StictionParameters,
    drive_of,
    imperfections,
)
from parallel_robot_sim.plant import PlantParameters
from trajectory_gen import configuration
from trajectory_gen.shapes import shapes
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


DECLARED = (
    ('plant', PlantParameters),
    ('sensor', SensorParameters),
    ('actuator', ActuatorParameters),
    ('disturbance', LoadParameters),
    ('compliance', ComplianceParameters),
    ('stiction', StictionParameters),
)


def declared(robot: Robot) -> Declared:
    """Groups of the plant."""
    yield 'true_robot', robot.Parameters
    yield from registry.JOINT_LOADS
    yield 'safety', SafetyParameters
    yield from DECLARED


def configure(values: Mapping[str, Any]) -> Configuration:
    """Build the configuration of an experiment from a resolved one.

    Raises:
        InputError: a value is wrong, even one that is not used.
    """
    loop = loop_of(values)
    with locating(values):
        robot, laws = module_of(loop), control.available(loop.custom_laws)
        known = shapes(loop.custom_trajectories)
        groups = build_groups(
            values,
            [
                *registry.declared_groups(robot),
                *configuration.declared(robot, known),
                *control.declared(robot, laws),
                *DECLARED,
            ],
        )
        nominal = robot_with(robot, loop, groups.at('robot', robot.Parameters))
        start = groups[PlantParameters].initial_pose
        configuration.check_columns(values, nominal)
        trajectory = configuration.trajectory_from(groups, nominal, known, start)
        guess = groups[ControllerParameters].guess or trajectory.first_pose
        controller = control.control_from(loop, groups, nominal, laws, guess, lambda: trajectory)
        return Configuration(
            values, loop, trajectory, controller, _plant_from(loop, robot, groups, values)
        )


def configure_plant(values: Mapping[str, Any]) -> PlantConfiguration:
    """Build the configuration of the plant from a resolved one.

    Raises:
        InputError: a value is wrong.
    """
    loop = loop_of(values)
    with locating(values):
        robot = module_of(loop)
        return _plant_from(loop, robot, build_groups(values, declared(robot)), values)


def _plant_from(
    loop: LoopParameters, robot: Robot, groups: Groups, values: Mapping[str, Any]
) -> PlantConfiguration:
    """Build the configuration of the plant from typed groups."""
    for key in ('true_robot.actuated', 'true_robot.held'):  # of a described machine
        nominal = values.get(key.removeprefix('true_'))
        if values.get(key, nominal) != nominal:
            raise InputError(f'{key} must be {key.removeprefix("true_")}, {nominal}', key)
    parameters = groups.at('true_robot', robot.Parameters)
    sensor, actuator = groups[SensorParameters], groups[ActuatorParameters]
    friction = groups[FrictionParameters]
    true = robot_with(robot, loop, parameters, 'true_robot')
    return PlantConfiguration(
        loop,
        true,
        groups[PlantParameters],
        JointLoad(friction, groups[DisturbanceParameters]),
        groups[SafetyParameters],
        imperfections(
            loop.seed,
            loop.period,
            sensor,
            actuator,
            groups[LoadParameters],
            drive_of(groups[ComplianceParameters], groups[StictionParameters], friction),
            true.joint_units.slides,
        ),
    )
