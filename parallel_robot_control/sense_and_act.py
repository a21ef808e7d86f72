"""What a cycle does before and after the law: it looks at the robot, and limits the torque."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.prepared_law import LawOutput
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.checks import (
    LOOKED_AT,
    SHORT,
    is_resisted,
    stopping_distance,
    too_fast,
)
from parallel_robot_control.safety.limiting import (
    ZERO,
    When,
    find_fault,
    limit_torque,
    safe_torque,
)
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, is_finite, multiply, select, some
from parallel_robot_model.robots.contract import Model

# What a cycle knows of the robot: its pose, its model, and the faults that they show.

LEAP = 0.05  # rad, of a joint between two states, after which nobody knows how the robot got there


class Sensed(NamedTuple):
    """What a cycle knows of the robot."""

    cause: int  # fault whose cause is there now, else NONE
    fault: int  # the latched fault, else the cause
    pose: Array  # pose, shape (m,)
    model: Model  # equations of motion; zero where the robot has none
    lost: bool  # whether the pose is lost: the robot may be in another assembly mode


@internal
def sense(
    setup: Any,
    reference: JointReference,
    position: Array,
    velocity: Array,
    effort: Array,
    state_fault: int,
    when: When,
    since: float,
    late: float,
) -> Sensed:
    """Find the pose, look for faults, compute the model.

    A fault in the motion of the joints comes before one that torques and states show, one of the
    robot after it, one ahead of the robot last.

    Args:
        setup: The ControlSetup.
        reference: Desired joint motion.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        effort: Torque since the state before [N m], shape (n,); NaN where it is not known.
        state_fault: Fault that torques and states show, else NONE.
        when: Times of the cycle.
        since: Time between the moments of this reference and the last one [s].
        late: From the measurement to the moment at which the torque acts [s].
    """
    safety, state, pose_loss_mask = setup.safety, setup.memory.state, setup.pose_loss_mask
    here = setup.estimate(setup.robot, setup.margins, position, velocity, state.pose)
    cause = find_fault(safety, state, reference, position, velocity, when.dt, since)
    cause = select(cause == faults.NONE, state_fault, cause)
    cause = select(cause == faults.NONE, here.fault, cause)
    if (
        cause == faults.NONE
        and stopping_distance(safety, multiply(here.model.M, velocity)) > SHORT
    ):
        fast = too_fast(setup, position, velocity, here, late)
        cause = select(fast, faults.TOO_FAST, faults.NONE)
    applied = select(effort - effort == 0.0, effort, state.torque)
    if some(np.abs(applied) > LOOKED_AT * safety.residual_limit):
        comparable = state.initialized and not when.dt > safety.gap
        resisted = is_resisted(setup, here.model, velocity, applied, when, comparable)
        if resisted and cause == faults.NONE:
            cause = faults.TORQUE_RESISTED
    fault = select(state.fault == faults.NONE, cause, state.fault)
    leap = select(safety.speed_limit * when.dt < LEAP, LEAP, safety.speed_limit * when.dt)
    leapt = state.initialized and some(np.abs(position - state.position) > leap)
    lost = state.lost | ((pose_loss_mask >> here.fault) & 1 != 0) | (leapt and pose_loss_mask != 0)
    return Sensed(cause, fault, here.pose, here.model, lost)


# What becomes of the torque that a law demands: limited, or replaced by the safe action.


@internal
def act(
    setup: Any,
    reference: JointReference,
    position: Array,
    velocity: Array,
    sensed: Sensed,
    blind: bool,
    output: LawOutput,
    dt: float,
) -> tuple[LawOutput, int]:
    """Limit the torque that the law demands, or replace it with the safe action.

    What was seen and done is the CycleState of the next cycle.

    Args:
        setup: The ControlSetup.
        reference: Desired joint motion at the state's stamp.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        sensed: What is known of the robot.
        blind: Whether positions and rates are not to be believed: then nothing is damped.
        output: Output of the law; ignored in a fault.
        dt: Time since the previous state [s].

    Returns:
        What becomes of it; bits of the limits that acted.
    """
    safety, state, fault = setup.safety, setup.memory.state, sensed.fault
    demand, sliding_variable, coupled_error = output
    # 1. A demand that is not finite is a fault, too.
    finite = is_finite(demand)
    fault = select((fault == faults.NONE) & (finite == False), faults.TORQUE_NOT_FINITE, fault)  # noqa: E712
    # 2. In a fault, the safe action replaces the demand; a ramp that is not over is dropped.
    failed = fault != faults.NONE
    if failed and (state.fault == faults.NONE or not state.initialized):
        state.fault_position = position
    zero = np.zeros_like(position)
    safe = select(blind, zero, safe_torque(safety, state.fault_position, position, velocity))
    safe = safe + select(safety.action == ZERO, zero, sensed.model.gravity)
    demand = select(failed, safe, demand)
    sliding_variable = select(failed, zero, sliding_variable)
    coupled_error = select(failed, reference.position - position, coupled_error)
    if failed:
        state.offset, state.bumpless = zero, False
    # 3. The limits; the next cycle continues from what they let through.
    torque, excess, offset, active_limits = limit_torque(safety, demand, state, setup.period, dt)
    state.position, state.reference, state.torque = position, reference.position, torque
    state.offset, state.excess, state.bumpless, state.initialized = offset, excess, False, True
    state.fault = fault
    return LawOutput(torque, sliding_variable, coupled_error), active_limits
