"""A controller put together from its configuration: law, robot and limits, ready to run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.assembly_mode import losing
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.cycle import ControlSetup, CycleState, cycle_memory, initial_state
from parallel_robot_control.estimation.estimator import estimator_of
from parallel_robot_control.prepared_law import PreparedLaw, prepare
from parallel_robot_control.repetition import repetition_of
from parallel_robot_control.safety import faults, limiting
from parallel_robot_control.safety.limiting import limits_of
from parallel_robot_control.terms import asked_of
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, Struct, vector
from parallel_robot_model.processes.custom_module import distinguish
from parallel_robot_model.robots.contract import PoseMotion


class Control(NamedTuple):
    """A controller before its first state."""

    law: PreparedLaw
    setup: ControlSetup  # law, robot and limits of the control cycle
    state: CycleState  # state before the first cycle


def assemble(
    configuration: ControlConfiguration, law: str = '', memory: Struct | None = None
) -> Control:
    """Put a controller together.

    Args:
        configuration: The configuration.
        law: Name of its law; empty for the active one.
        memory: Memory of the cycle, of :func:`memory_of`, which laws that follow each other
            share; None: a new one.

    Raises:
        InputError: the theory of the law forbids its gains, or a custom law does not compile or
            does not pass its trial.
    """
    name = law or configuration.loop.law
    gains, robot = configuration.gains[name], configuration.robot
    prepared = prepare(name, configuration.laws[name], gains, configuration.joints)
    if prepared.foreign is not None:
        prepared.foreign.judge_loop(configuration.loop.period, robot.joint_units)
    row, guess = vector(np.zeros(configuration.joints)), vector(np.array(configuration.guess))
    distinguish(type(configuration.margins))
    state = configuration.margins, row, row, guess
    estimate = robot.kernel('estimate', *state)
    limits = Boxed(
        limits_of(configuration.safety, configuration.margins, configuration.loop.period)
    )
    period, memory = configuration.loop.period, memory or memory_of(configuration)
    estimator = Boxed(
        estimator_of(
            configuration.estimator,
            configuration.lock_in,
            configuration.laws[name],
            period,
            memory,
        )
    )
    if estimator.lock_in.on:
        limiting.check_lock_in(
            estimator.lock_in, limits.value, inertia_of(configuration), robot.joint_units
        )
    fault = faults.EMERGENCY_STOP if configuration.stopped else faults.NONE
    return Control(
        prepared,
        ControlSetup(
            prepared.step,
            estimate,
            robot.kernel('estimate', *state, instead='ahead'),
            robot.kernel('locate', row, guess),
            asked_of(configuration.laws[name], robot),
            prepared.law,
            robot.constants,
            limits,
            estimator,
            configuration.approach,
            losing(robot, configuration.margins, row, guess),
            memory,
            Boxed(
                repetition_of(
                    configuration.repetition,
                    configuration.turn,
                    configuration.laws[name],
                    period,
                    memory.repetition,
                )
            ),
        ),
        initial_state(guess, configuration.joints)._replace(fault=fault),
    )


def memory_of(configuration: ControlConfiguration) -> Struct:
    """Memory of the cycle of a controller, before its first state."""
    return cycle_memory(configuration.joints, configuration.turn)


def inertia_of(configuration: ControlConfiguration) -> Array:
    """Inertia matrix of the nominal robot at rest at the guess [kg m^2], shape (n, n)."""
    robot, guess = configuration.robot, vector(np.array(configuration.guess))
    still, row = vector(np.zeros(len(guess))), vector(np.zeros(configuration.joints))
    joints = robot.module.joint_motion(robot.constants, PoseMotion(guess, still, still))
    position, margins = vector(joints.position), configuration.margins
    estimate = robot.module.estimate(robot.constants, margins, position, row, guess)
    return np.asarray(estimate.model.M)
