"""An experiment put together from its configuration: desired motion, controller and plant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control import assembly as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.safety.limiting import SafetyParameters, safe_action
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import Boxed, vector
from parallel_robot_model.configuration.hazards import KEY, Hazard, parse
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.processes.custom_module import blaming
from parallel_robot_model.robots.robot_checks import refuse_mistakes
from parallel_robot_sim.configuration import Configuration, PlantConfiguration
from parallel_robot_sim.drive_step import with_steps
from parallel_robot_sim.hazards import Patience, table_of
from parallel_robot_sim.imperfections import yielding
from parallel_robot_sim.plant import MUJOCO, PlantSetup, PlantState, stepping
from trajectory_gen import preflight
from trajectory_gen.trajectory import Reference, Trajectory


class Plant(NamedTuple):
    """The plant at rest at its initial pose.

    Attributes:
        setup: What it is made of.
        state: Its state.
        hazards: What happens to it.
        safety: Time-outs of the loop.
    """

    setup: PlantSetup
    state: PlantState
    hazards: tuple[Hazard, ...]
    safety: SafetyParameters


class Experiment(NamedTuple):
    """A closed loop before its first sample.

    Attributes:
        loop: Period, joints, law and the like.
        trajectory: Desired motion, which the robot can perform.
        control: The controller.
        plant: The plant.
        known: The first samples of the motion, if they were wanted.
    """

    loop: LoopParameters
    trajectory: Trajectory
    control: Control
    plant: Plant
    known: Reference | None = None


def assemble(configuration: Configuration, samples: int = 0) -> Experiment:
    """Put an experiment together.

    Args:
        configuration: The configuration.
        samples: Number of samples of the motion that are wanted.

    Raises:
        InputError: the robot cannot perform the motion or does not reach its initial pose, or a
            law cannot be used.
    """
    controller = control.assemble(configuration.control)
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
    setup = PlantSetup(
        robot.kernel('acceleration', load, start, still, torque, 0.0),
        robot.kernel('measure', start, still),
        stepping(configuration.parameters),
        robot.constants,
        load,
        Boxed(imperfections.with_memory(torque)),
        Boxed(
            Patience(
                max(1, round(configuration.parameters.command_timeout / loop.period)),
                safe_action(configuration.parameters.timeout_action, configuration.safety),
            )
        ),
        Boxed(table_of(hazards, loop.joints, loop.period)),
    )
    state = PlantState(start, still, torque, 0.0)
    if flexible:
        fine = with_steps(drive, setup, state, loop.period, setup.stepping.substeps)
        boxed = Boxed(imperfections._replace(drive=fine).with_memory(torque))
        setup = setup._replace(imperfections=boxed)
    return Plant(setup, state, hazards, configuration.safety)


def _hazards(configuration: PlantConfiguration) -> tuple[Hazard, ...]:
    """The hazards of a loop.

    Raises:
        InputError: one cannot happen to this plant.
    """
    hazards, least = parse(configuration.loop.hazards), configuration.safety.state_age
    for k, hazard in enumerate(hazards):
        what = f'{KEY}[{k}]: {hazard.what}'
        if hazard.what == 'states_ahead' and hazard.size <= least:
            text = f'{what} needs a size above safety.state_age, {least:g} s, not {hazard.size:g}'
            raise InputError(text, KEY)
        if hazard.what == 'brakes' and configuration.parameters.engine == MUJOCO:
            raise InputError(f'{what} needs plant.engine analytic', KEY)
    return hazards
