"""A controller put together from its configuration: law, robot and limits, ready to run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.assembly_mode import pose_loss_mask
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.cycle import ControlSetup, CycleState, cycle_memory, initial_state
from parallel_robot_control.estimation import lock_in
from parallel_robot_control.estimation.estimator import IDENTIFY, resolved
from parallel_robot_control.prepared_law import PreparedLaw, prepare
from parallel_robot_control.repetition import repetition_memory
from parallel_robot_control.safety import faults, limiting
from parallel_robot_control.safety.limiting import as_limits
from parallel_robot_control.terms import requested_place
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, Struct, as_constants, vector
from parallel_robot_model.processes.custom_module import qualify_type_names
from parallel_robot_model.robots.contract import PoseMotion


class Control(NamedTuple):
    """A controller before its first state."""

    law: PreparedLaw
    setup: Boxed  # ControlSetup: law, robot and parameters of the control cycle
    state: CycleState  # of its memory


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
    memory = memory or memory_of(configuration)
    name, period = law or configuration.loop.law, configuration.loop.period
    module, robot = configuration.laws[name], configuration.robot
    prepared = prepare(name, module, configuration.gains[name], configuration.joints)
    if prepared.foreign is not None:
        prepared.foreign.check_loop(period, robot.joint_units)
    row, guess = vector(np.zeros(configuration.joints)), vector(np.array(configuration.guess))
    qualify_type_names(type(configuration.margins))
    state = configuration.margins, row, row, guess
    identification = configuration.lock_in
    estimator = resolved(configuration.estimator, identification, module, period)
    safety = as_limits(configuration.safety, period)
    identifies = configuration.estimator.delay == IDENTIFY
    if identifies:
        lock_in.check(identification, period)
        inertia = inertia_of(configuration)
        limiting.check_lock_in(identification, safety, inertia, robot.joint_units)
    setup = ControlSetup(
        prepared.step,
        robot.kernel('estimate', *state),
        robot.kernel('estimate', *state, instead='estimate_coarse'),
        robot.kernel('locate', row, guess),
        prepared.law,
        requested_place(module, robot),
        bool(module.MODEL),
        robot.constants,
        configuration.margins,
        pose_loss_mask(robot, configuration.margins, row, guess),
        period,
        configuration.repetition_samples,
        identifies,
        Boxed(safety),
        Boxed(as_constants(estimator)),
        Boxed(as_constants(identification)),
        Boxed(as_constants(configuration.approach)),
        Boxed(as_constants(configuration.repetition._replace(period=0.0))),
        memory,
    )
    return Control(prepared, Boxed(setup), memory.state.value)


def memory_of(configuration: ControlConfiguration) -> Struct:
    """Memory of the cycle of a controller, before its first state."""
    joints, turn = configuration.joints, configuration.repetition_samples
    period, parameters = configuration.loop.period, configuration.repetition
    of_turns = repetition_memory(parameters, joints, turn, period)
    fault = faults.EMERGENCY_STOP if configuration.stopped else faults.NONE
    state = initial_state(np.array(configuration.guess), joints)._replace(fault=fault)
    return cycle_memory(state, of_turns)


def inertia_of(configuration: ControlConfiguration) -> Array:
    """Inertia matrix of the nominal robot at rest at the guess [kg m^2], shape (n, n)."""
    robot, guess = configuration.robot, vector(np.array(configuration.guess))
    still, row = vector(np.zeros(len(guess))), vector(np.zeros(configuration.joints))
    joints = robot.module.joint_motion(robot.constants, PoseMotion(guess, still, still))
    position, margins = vector(joints.position), configuration.margins
    estimate = robot.module.estimate(robot.constants, margins, position, row, guess)
    return np.asarray(estimate.model.M)
