"""From a configuration to a whole experiment: motion, controller and plant."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control import assembly as control_assembly
from parallel_robot_control import configuration as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.contract import Law
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import Boxed, as_constants, vector
from parallel_robot_model.configuration.fields import (
    Declared,
    Parameter,
    declared_in,
    grouped,
    parameters,
)
from parallel_robot_model.configuration.hazard_table import HazardTable
from parallel_robot_model.configuration.hazards import KEY, Hazard, parse
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.processes.custom_module import wrap_user_errors
from parallel_robot_model.robots import registry
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.joint_load import JointLoad, check_friction
from parallel_robot_model.robots.registry import RobotConfiguration
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
from trajectory_gen.shapes import SHAPES, Shape
from trajectory_gen.trajectory import Reference, Trajectory


class Configuration(ControlConfiguration):
    """An experiment: desired motion, controller and plant."""

    plant = grouped('plant', PlantParameters)
    sensor = grouped('sensor', SensorParameters)
    actuator = grouped('actuator', ActuatorParameters)
    loads = grouped('disturbance', LoadParameters)
    compliance = grouped('compliance', ComplianceParameters)
    stiction = grouped('stiction', StictionParameters)

    @cached_property
    def joint_load(self) -> JointLoad:
        """Friction and disturbance of the actuated joints."""
        return JointLoad(self.friction, self.disturbance)

    @cached_property
    def imperfections(self) -> Imperfections:
        """Those of sensors, motors and loads."""
        with with_location(self.values):
            return imperfections(
                self.loop.seed,
                self.loop.period,
                self.sensor,
                self.actuator,
                self.loads,
                drive_of(self.compliance, self.stiction, self.friction),
                self.true_robot.joint_units.slides,
            )

    def check_plant(self) -> None:
        """Find what is wrong in the parameters of the plant.

        Raises:
            InputError: a value is wrong.
        """
        with with_location(self.values):
            for key in ('true_robot.actuated', 'true_robot.held'):  # of a described machine
                nominal = self.values.get(key.removeprefix('true_'))
                if self.values.get(key, nominal) != nominal:
                    raise InputError(f'{key} must be {key.removeprefix("true_")}, {nominal}', key)
        self.check(declared(self.true_robot.module))
        with with_location(self.values):
            check_friction(self.friction)
        _ = self.imperfections


def declared(robot: Robot) -> Declared:
    """Groups of the plant."""
    yield 'true_robot', robot.Parameters
    yield from declared_in(RobotConfiguration)
    yield 'safety', SafetyParameters
    yield from declared_in(Configuration)


def configure(values: Mapping[str, Any]) -> Configuration:
    """Build the configuration of an experiment from a resolved one.

    Raises:
        InputError: a value is wrong, even one that is not used.
    """
    configuration = Configuration(values)
    configuration.check(registry.declared_groups(configuration.robot.module))
    configuration.check_motion()
    _ = configuration.trajectory
    configuration.check_control()
    configuration.check_plant()
    return configuration


def configure_plant(values: Mapping[str, Any]) -> Configuration:
    """Build the configuration of the plant from a resolved one; the rest is not looked at.

    Raises:
        InputError: a value is wrong.
    """
    configuration = Configuration(values)
    configuration.check_plant()
    return configuration


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
        'Plant, sensors and motors': declared_in(Configuration),
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
    hazards: HazardTable  # what happens to it
    safety: SafetyParameters  # time-outs of the loop


class Experiment(NamedTuple):
    """A closed loop before its first sample."""

    loop: LoopParameters  # period, joints, law and the like
    trajectory: Trajectory  # desired motion, which the robot can perform
    control: Control  # the controller
    plant: Plant
    first_samples: Reference | None = None  # the first samples of the motion, if they were wanted


def assemble(configuration: Configuration, samples: int = 0) -> Experiment:
    """Put an experiment together.

    Args:
        configuration: The configuration.
        samples: Number of samples of the motion that are wanted.

    Raises:
        InputError: the robot cannot perform the motion or does not reach its initial pose, or a
            law cannot be used.
    """
    controller = control_assembly.assemble(configuration)
    plant = assemble_plant(configuration)
    trajectory, period = configuration.trajectory, configuration.loop.period
    known = trajectory.sample(np.arange(samples) * period) if samples else None
    preflight.check(trajectory, period, known)
    return Experiment(configuration.loop, trajectory, controller, plant, known)


def assemble_plant(configuration: Configuration) -> Plant:
    """Put the plant together, at rest at its initial pose.

    Raises:
        InputError: the robot does not reach that pose, or a custom robot contradicts itself.
    """
    robot, loop = configuration.true_robot, configuration.loop
    hazards = _hazards(configuration)
    module, parameters = robot.module, robot.parameters
    imperfections = configuration.imperfections
    drive = imperfections.drive
    flexible = imperfections.on and drive.on
    if flexible and configuration.plant.engine == MUJOCO:
        raise InputError('compliance and stiction need plant.engine analytic', 'plant.engine')
    loads = configuration.joint_load
    load = Boxed(loads._replace(friction=yielding(drive)) if flexible else loads)
    pose = np.array(robot.pose_of('plant.initial_pose', configuration.plant.initial_pose))
    with wrap_user_errors(robot.name):
        start = vector(module.start(parameters, pose))
    refuse_mistakes(robot, loads, pose)
    still, torque = vector(np.zeros(len(start))), vector(np.zeros(len(loop.joints)))
    own, joints = configuration.plant, len(loop.joints)
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
    table = HazardTable(loop, configuration.safety.state_age)
    return Plant(setup, state, table, configuration.safety)


def _hazards(configuration: Configuration) -> tuple[Hazard, ...]:
    """The hazards of a loop."""
    hazards, least = parse(configuration.loop.hazards), configuration.safety.state_age
    for k, hazard in enumerate(hazards):
        what = f'{KEY}[{k}]: {hazard.what}'
        if hazard.what == 'states_ahead' and hazard.size <= least:
            text = f'{what} needs a size above safety.state_age, {least:g} s, not {hazard.size:g}'
            raise InputError(text, KEY)
        if hazard.what == 'brakes' and configuration.plant.engine == MUJOCO:
            raise InputError(f'{what} needs plant.engine analytic', KEY)
    return hazards
