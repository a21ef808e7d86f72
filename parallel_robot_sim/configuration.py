"""From a configuration to a whole experiment: motion, controller and plant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control import assembly as control_assembly
from parallel_robot_control import configuration as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.configuration import ControlConfiguration, ControllerParameters
from parallel_robot_control.contract import Law
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import Boxed, as_constants, vector
from parallel_robot_model.configuration.fields import (
    Declared,
    Groups,
    Parameter,
    build_groups,
    parameters,
)
from parallel_robot_model.configuration.hazards import KEY, Hazard, parse
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.configuration.plain_data import locating
from parallel_robot_model.processes.custom_module import blaming
from parallel_robot_model.robots import registry
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
    check_friction,
)
from parallel_robot_model.robots.registry import RobotModel, robot_of, robot_with
from parallel_robot_model.robots.robot_checks import refuse_mistakes
from parallel_robot_sim.drive_step import with_steps
from parallel_robot_sim.hazards import table_of
from parallel_robot_sim.imperfections import (
    ActuatorParameters,
    ComplianceParameters,
    Imperfections,
    LoadParameters,
    SensorParameters,
    StictionParameters,
    drive_of,
    imperfections,
    yielding,
)
from parallel_robot_sim.plant import MUJOCO, PlantParameters, PlantSetup, PlantState
from trajectory_gen import configuration as motion
from trajectory_gen import preflight
from trajectory_gen.shapes import SHAPES, Shape, shapes
from trajectory_gen.trajectory import Reference, Trajectory


class PlantConfiguration(NamedTuple):
    """Configuration of the plant."""

    loop: LoopParameters  # period, joints and the like
    robot: RobotModel  # true robot
    parameters: PlantParameters  # start, integration and motors
    load: JointLoad  # friction and disturbance of the actuated joints
    safety: SafetyParameters  # gains of the safe action of the motors
    imperfections: Imperfections  # those of sensors, motors and loads


class Configuration(NamedTuple):
    """Configuration of an experiment."""

    values: Mapping[str, Any]  # all keys with their plain values, for bags and for people
    loop: LoopParameters  # period, joints, law and the like
    trajectory: Trajectory  # desired motion on the nominal robot
    control: ControlConfiguration  # configuration of the controller
    plant: PlantConfiguration  # configuration of the plant


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
    loop, nominal = loop_of(values), robot_of(values)
    with locating(values):
        robot, laws = nominal.module, control.available(loop.custom_laws)
        known = shapes(loop.custom_trajectories)
        groups = build_groups(
            values,
            [
                *registry.declared_groups(robot),
                *motion.declared(robot, known),
                *control.declared(robot, laws),
                *DECLARED,
            ],
        )
        start = groups[PlantParameters].initial_pose
        motion.check_columns(values, nominal)
        trajectory = motion.trajectory_from(groups, nominal, known, start)
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
    loop, robot = loop_of(values), robot_of(values, 'true_robot').module
    with locating(values):
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
    check_friction(friction)
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


# The groups in which the parameters of an experiment are declared, by title.


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
        'Motion': [*motion.declared(robot, {})],
        'Shapes of the motion': [*motion.of_shapes(shapes)],
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


# An experiment put together from its configuration: desired motion, controller and plant.


class Plant(NamedTuple):
    """The plant at rest at its initial pose."""

    setup: PlantSetup  # what it is made of
    state: PlantState
    hazards: tuple[Hazard, ...]  # what happens to it
    safety: SafetyParameters  # time-outs of the loop


class Experiment(NamedTuple):
    """A closed loop before its first sample."""

    loop: LoopParameters  # period, joints, law and the like
    trajectory: Trajectory  # desired motion, which the robot can perform
    control: Control  # the controller
    plant: Plant
    known: Reference | None = None  # the first samples of the motion, if they were wanted


def assemble(configuration: Configuration, samples: int = 0) -> Experiment:
    """Put an experiment together.

    Args:
        configuration: The configuration.
        samples: Number of samples of the motion that are wanted.

    Raises:
        InputError: the robot cannot perform the motion or does not reach its initial pose, or a
            law cannot be used.
    """
    controller = control_assembly.assemble(configuration.control)
    plant = assemble_plant(configuration.plant)
    trajectory, period = configuration.trajectory, configuration.loop.period
    known = trajectory.sample(np.arange(samples) * period) if samples else None
    preflight.check(trajectory, period, known)
    return Experiment(configuration.loop, trajectory, controller, plant, known)


def assemble_plant(configuration: PlantConfiguration) -> Plant:
    """Put the plant together, at rest at its initial pose.

    Raises:
        InputError: the robot does not reach that pose, or a custom robot contradicts itself.
    """
    robot, loop = configuration.robot, configuration.loop
    hazards = _hazards(configuration)
    module, parameters = robot.module, robot.parameters
    imperfections = configuration.imperfections
    drive = imperfections.drive
    flexible = imperfections.on and drive.on
    if flexible and configuration.parameters.engine == MUJOCO:
        raise InputError('compliance and stiction need plant.engine analytic', 'plant.engine')
    loads = configuration.load
    load = Boxed(loads._replace(friction=yielding(drive)) if flexible else loads)
    pose = np.array(robot.pose_of('plant.initial_pose', configuration.parameters.initial_pose))
    with blaming(robot.name):
        start = vector(module.start(parameters, pose))
    refuse_mistakes(robot, configuration.load, pose)
    still, torque = vector(np.zeros(len(start))), vector(np.zeros(len(loop.joints)))
    own, joints = configuration.parameters, len(loop.joints)
    setup = PlantSetup(
        robot.kernel('acceleration', load, start, still, torque, 0.0),
        robot.kernel('measure', start, still),
        Boxed(as_constants(own)),
        robot.constants,
        load,
        imperfections.constants(joints),
        Boxed(as_constants(configuration.safety._replace(action=own.timeout_action))),
        max(1, round(own.command_timeout / loop.period)),
        Boxed(table_of(hazards, loop.joints, loop.period)),
    )
    state = PlantState(start, still, torque, 0.0)
    if flexible:
        fine = with_steps(drive, setup, state, loop.period, own.substeps)
        setup = setup._replace(imperfections=imperfections._replace(drive=fine).constants(joints))
    return Plant(setup, state, hazards, configuration.safety)


def _hazards(configuration: PlantConfiguration) -> tuple[Hazard, ...]:
    """The hazards of a loop."""
    hazards, least = parse(configuration.loop.hazards), configuration.safety.state_age
    for k, hazard in enumerate(hazards):
        what = f'{KEY}[{k}]: {hazard.what}'
        if hazard.what == 'states_ahead' and hazard.size <= least:
            text = f'{what} needs a size above safety.state_age, {least:g} s, not {hazard.size:g}'
            raise InputError(text, KEY)
        if hazard.what == 'brakes' and configuration.parameters.engine == MUJOCO:
            raise InputError(f'{what} needs plant.engine analytic', KEY)
    return hazards
