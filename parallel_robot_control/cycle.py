"""One control cycle: kinematics, faults, law, limits; the same kernel with and without ROS."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.function_value import FirstClass
from parallel_robot_base.kernel import inner, kernel
from parallel_robot_control import faults
from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.safety import Last, Limits, find_fault, limit_torque, safe_torque
from parallel_robot_model.contract import Estimate

Array = NDArray[np.float64]


class CycleState(NamedTuple):
    """What one cycle hands to the next.

    Attributes:
        pose: Pose by forward kinematics, shape (m,); the guess for the next one.
        last: What the cycle saw and did.
        excess: Torque of the law that the limits cut off [N m], shape (n,).
        held: Joint angles at the moment of the fault [rad], shape (n,).
        fault: NONE or the number of the fault, see faults.py; it is latched.
    """

    pose: Array
    last: Last
    excess: Array
    held: Array
    fault: int


class ControlSetup(NamedTuple):
    """The constant parts of a controller.

    Attributes:
        update: Update of the law, as FirstClass.
        estimate: Estimate of the robot module, as FirstClass.
        gains: Gains of the law.
        robot: Parameters of the nominal robot.
        limits: Limits, safe action and margins.
    """

    update: Any
    estimate: Any
    gains: Any
    robot: Any
    limits: Limits


class Asked(NamedTuple):
    """What a law asks for: torque [N m], sliding variable, e_c [rad], each shape (n,)."""

    torque: Array
    sliding_variable: Array
    coupled_error: Array


class Acted(NamedTuple):
    """A Cycle without the memory, whose type depends on the law."""

    torque: Array
    sliding_variable: Array
    coupled_error: Array
    acted: int
    state: CycleState


class Cycle(NamedTuple):
    """Result of one control cycle.

    Attributes:
        torque: Commanded torque [N m], shape (n,).
        sliding_variable: Sliding variable in the law's unit, shape (n,); zero in a fault.
        coupled_error: e_c [rad], shape (n,); e in a fault.
        acted: Bits of the limits that acted.
        state: State of the controller for the next cycle.
        memory: Memory of the law for the next cycle.
    """

    torque: Array
    sliding_variable: Array
    coupled_error: Array
    acted: int
    state: CycleState
    memory: Any


def initial_state(pose: Array, joints: int) -> CycleState:
    """State before the first cycle: no torque, and the first one is not ramped.

    Args:
        pose: Pose from which the forward kinematics starts, shape (m,).
        joints: Number of the actuated joints, n.
    """
    zero = np.zeros(joints)
    return CycleState(pose, Last(zero, zero, zero, zero, False, False), zero, zero, faults.NONE)


@inner
def is_finite(x: Array) -> bool:
    """Whether all elements of a vector are finite."""
    finite = True
    for i in range(len(x)):
        finite = finite and np.isfinite(x[i])
    return finite


@inner
def sense(
    estimate: Any,
    robot: Any,
    limits: Limits,
    reference: JointReference,
    position: Array,
    velocity: Array,
    state: CycleState,
    dt: float,
) -> Estimate:
    """Find the pose, look for faults, compute the model. Arguments as of :func:`run_cycle`.

    Returns:
        The estimate; its fault is the latched one, or else the first one found, first in the
        motion of the joints, then in the robot.
    """
    found = estimate(robot, limits.margins, position, velocity, state.pose)
    fault = state.fault
    if fault == faults.NONE:
        fault = find_fault(limits, reference, position, velocity, state.last, dt)
    if fault == faults.NONE:
        fault = found.fault
    return Estimate(fault, found.pose, found.model)


@inner
def act(
    limits: Limits,
    reference: JointReference,
    position: Array,
    velocity: Array,
    state: CycleState,
    sensed: Estimate,
    asked: Asked,
    dt: float,
) -> Acted:
    """Limit the torque that the law asks for, or replace it with the safe action.

    Args:
        limits: Limits, safe action and margins.
        reference: Desired joint motion at the state's stamp.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        state: State of the controller after the cycle before.
        sensed: Pose, fault and model of the robot.
        asked: Output of the law; ignored in a fault.
        dt: Time since the previous state [s].
    """
    fault, last, held = sensed.fault, state.last, state.held
    demand, sliding_variable, coupled_error = asked
    # 1. A demand that is not finite is a fault, too.
    if fault == faults.NONE and not is_finite(demand):
        fault = faults.TORQUE_NOT_FINITE
    # 2. In a fault, the safe action replaces the demand; a ramp that is not over is dropped.
    if fault != faults.NONE:
        if state.fault == faults.NONE or not last.known:
            held = position
        demand = safe_torque(limits.safe, held, position, velocity)
        sliding_variable = np.zeros(len(position))
        coupled_error = reference.position - position
        last = Last(
            last.position, last.reference, last.torque, np.zeros(len(demand)), False, last.known
        )
    # 3. The limits; the next cycle continues from what they let through.
    torque, excess, offset, acted = limit_torque(limits, demand, last, dt)
    last = Last(position, reference.position, torque, offset, False, True)
    after = CycleState(sensed.pose, last, excess, held, fault)
    return Acted(torque, sliding_variable, coupled_error, acted, after)


@kernel
def run_cycle(
    setup: ControlSetup,
    reference: JointReference,
    position: Array,
    velocity: Array,
    state: CycleState,
    memory: Any,
    dt: float,
) -> Cycle:
    """Compute the torque for one joint state.

    Only this function is compiled for each law; what it calls is compiled once for each robot.

    Args:
        setup: Law, robot and limits.
        reference: Desired joint motion at the state's stamp.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        state: State of the controller after the cycle before.
        memory: Memory of the law.
        dt: Time since the previous state [s].
    """
    # 1. Pose, model and faults of the robot.
    limits = setup.limits
    sensed = sense(setup.estimate, setup.robot, limits, reference, position, velocity, state, dt)
    # 2. The torque that the law asks for; in a fault it is not called.
    asked = Asked(position, position, position)
    advanced = memory
    if sensed.fault == faults.NONE:
        feedback = Feedback(position, velocity, state.excess)
        output = setup.update(setup.gains, sensed.model, reference, feedback, memory, dt)
        asked = Asked(output.torque, output.sliding_variable, output.coupled_error)
        advanced = output.memory
    # 3. The same within the limits, or the safe action. In a fault the memory is kept.
    done = act(limits, reference, position, velocity, state, sensed, asked, dt)
    if done.state.fault == faults.NONE:
        memory = advanced
    return Cycle(
        done.torque,
        done.sliding_variable,
        done.coupled_error,
        done.acted,
        done.state,
        memory,
    )


def cycle_of(setup: ControlSetup, state: CycleState, memory: Any) -> FirstClass:
    """The cycle with a law as a value, so that loops are not compiled with all of it inside.

    Args:
        setup: Law, robot and limits.
        state: State of the controller.
        memory: Memory of the law.
    """
    row = np.zeros(len(state.held))
    reference = JointReference(row, row, row)
    return FirstClass(run_cycle, setup, reference, row, row, state, memory, 1e-3)
