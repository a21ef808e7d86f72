"""One control cycle: kinematics, faults, law, limits; the same kernel with and without ROS."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control import repetition
from parallel_robot_control.approach import (
    BACK,
    CONTINUES,
    START,
    ApproachMemory,
    approached,
)
from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.estimation import kalman, lock_in, recent_torques
from parallel_robot_control.estimation.estimator import (
    AGED,
    FILTER,
    KALMAN,
    LEVANT,
    NONE,
    Estimated,
    estimated,
)
from parallel_robot_control.prepared_law import LawOutput
from parallel_robot_control.reference_buffer import extrapolated
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.checks import (
    MIN_OUTAGE,
    ArrivalMemory,
    ConsistencyMemory,
    MomentumMemory,
    arrival,
    inconsistent,
)
from parallel_robot_control.safety.limiting import EFFORT, When
from parallel_robot_control.sense_and_act import act, sense
from parallel_robot_control.terms import NO_PLACE_REQUESTED, place_gradient
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    Boxed,
    FunctionValue,
    Struct,
    every,
    internal,
    kernel,
    select,
    vector,
    zeros_of,
)
from parallel_robot_model.messages.topics import Telemetry


class CycleState(NamedTuple):
    """What one cycle hands to the next, as a Struct; vectors have shape (n,) but for the pose."""

    pose: Array  # pose by forward kinematics, shape (m,); the guess for the next one
    position: Array  # measured angles [rad]
    reference: Array  # desired angles [rad]
    torque: Array  # torque applied [N m]
    offset: Array  # subtracted from the demanded torque; fades to zero after a take-over [N m]
    bumpless: bool  # bumpless transfer: whether the next torque must continue from `torque`
    initialized: bool  # whether `position` and `reference` were measured
    excess: Array  # torque of the law that the limits cut off [N m]
    fault_position: Array  # joint angles at the moment of the fault [rad]
    fault: int  # NONE or the number of the fault, see faults.py; it is latched
    estimated: Estimated  # estimates of filter and differentiator; not used without one
    begins: int  # what the next cycle begins: CONTINUES, START or BACK
    # whether the pose may be that of another assembly mode, see assembly_mode.py; it is latched
    lost: bool


class CycleMemory(NamedTuple):
    """What the cycle remembers; laws that follow each other share it."""

    state: Any  # CycleState; it and all that follows as a Struct
    torques: Any  # RecentTorques
    kalman: Any  # KalmanMemory
    lock_in: Any  # LockInMemory
    approach: Any  # ApproachMemory
    consistency: Any  # ConsistencyMemory
    arrival: Any  # ArrivalMemory
    momentum: Any  # MomentumMemory
    repetition: Any  # RepetitionMemory


def cycle_memory(state: CycleState, repetition_memory: Struct) -> Struct:
    """Memory before the first state; `repetition_memory`: what is remembered of turns."""
    zero = vector(np.zeros(len(state.fault_position)))
    parts = (
        kalman.KalmanMemory,
        lock_in.LockInMemory,
        ApproachMemory,
        ConsistencyMemory,
        ArrivalMemory,
        MomentumMemory,
    )
    begun = (Struct(zeros_of(each, zero)) for each in parts)
    torques = recent_torques.recent_torques(zero)
    return Struct(CycleMemory._make([Struct(state), torques, *begun, repetition_memory]))


class ControlSetup(NamedTuple):
    """The constant parts of a controller, boxed; parameters as :func:`as_constants`."""

    step: Any  # step of the law, as FunctionValue
    estimate: Any  # estimate of the robot module, as FunctionValue
    estimate_coarse: Any  # the same for states that are only predicted, as FunctionValue
    locate: Any  # its forward kinematics, as FunctionValue
    law: Any  # the law itself, an address; of one type for all laws
    place: int  # number of the coordinates of the place that the law asks for, see terms.py
    has_model: bool  # whether the law adds what the model knows, see repetition.py
    robot: Any  # constants of the nominal robot, boxed
    margins: Any  # its SafetyMargins
    pose_loss_mask: int  # its faults at which it has no pose, as bits
    period: float  # of the samples [s]
    # samples of a turn from which the next one learns; 0: nothing is learned
    repetition_samples: int
    identifies: bool  # whether the age of the states is identified
    safety: Any  # SafetyParameters, boxed, as all that follow; see as_limits
    estimator: Any  # EstimatorParameters, see resolved
    lock_in: Any  # LockInParameters
    approach: Any  # ApproachParameters
    repetition: Any  # RepetitionParameters but for the period of a turn
    memory: Any  # CycleMemory, a Struct


class Cycle(NamedTuple):
    """Result of one control cycle."""

    torque: Array  # commanded torque [N m], shape (n,)
    telemetry: Telemetry  # what is told of it
    active_limits: int  # bits of the limits that acted
    cause: int  # fault whose cause is there now, else NONE; the latched one is in the state


def initial_state(pose: Array, joints: int) -> CycleState:
    """State before the first cycle: no torque, and the first one is not ramped.

    Args:
        pose: Pose from which the forward kinematics starts, shape (m,).
        joints: Number of the actuated joints, n.
    """
    state: CycleState = zeros_of(CycleState, vector(np.zeros(joints)))
    return state._replace(pose=vector(pose), begins=START)


@internal
def join(state: Any, torque: Array) -> None:
    """Let the law begin anew, with an approach from where the robot is.

    Its torque goes on from the one that acts [N m], shape (n,); where that is not known, from the
    last one.
    """
    state.torque = select(np.abs(torque) < np.inf, torque, state.torque)
    state.excess, state.bumpless, state.begins = np.zeros_like(torque), True, BACK


@internal
def trip(state: Any, fault: int) -> None:
    """Enter a fault, if there is one, unless the controller already is in one."""
    if state.fault == faults.NONE and fault != faults.NONE:
        state.fault, state.fault_position = fault, state.position


@internal
def before_cycle(state: Any, torque: Array, cause: int, joins: bool) -> None:
    """Make the state what a cycle begins with.

    Args:
        state: The CycleState.
        torque: Torque that acts [N m], shape (n,).
        cause: STATES_STALE or REFERENCE_STALE if one of them stayed away for too long, else NONE.
        joins: Whether the law begins anew.
    """
    trip(state, cause)
    state.torque = torque
    if joins:
        join(state, torque)


@kernel
def run_cycle(
    setup: Any,
    desired: JointReference,
    position: Array,
    velocity: Array,
    effort: Array,
    when: When,
) -> Cycle:
    """Compute the torque for one joint state.

    A state may be old. The law compares it with the reference of the moment at which it was
    measured, or knows its age; or with a Kalman filter the motion predicted for the moment at
    which the torque acts with the reference of that moment.

    The memories of the law, which is not called in a fault, and of the cycle, which has the state
    of the controller, are written in place.

    Args:
        setup: The ControlSetup, boxed.
        desired: Desired joint motion at the sample from which on the torque acts.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        effort: Torque applied during the step that ended at the measurement [N m], shape (n,); NaN
            where it is not known.
        when: Age of the state, time since the one before.
    """
    safety, estimator, memory, dt = setup.safety, setup.estimator, setup.memory, when.dt
    seen, position = position, position - estimator.zero_angle
    state, identifies = memory.state, setup.identifies
    initialized = state.initialized
    if identifies:
        lock_in.reset(setup, when.sample, initialized, state.fault != faults.NONE)
    tracks, late = estimator.kind == KALMAN, when.age + lock_in.delay_at(setup, initialized)
    then = extrapolated(desired, -late)
    seen_error, seen_rate = then.position - seen, then.velocity - velocity
    # 1. Whether the last torque acted. After a gap, or when it acts again, the law begins anew.
    gap, begun = initialized and dt > safety.gap, state.begins
    delivered = arrival(setup, effort, when, initialized, initialized and not gap)
    excess, anew = state.excess + delivered.missing, False
    if (gap or delivered.restart) and state.fault == faults.NONE:
        join(state, effort)
        begun, anew, excess = BACK, True, state.excess
    if begun == BACK:
        memory.torques.tracked = False
    since = dt
    if tracks:
        since = recent_torques.between(memory.torques, when.age, initialized, dt)
    # 2. Velocity, reference, pose, model and faults of the robot.
    if estimator.kind == FILTER or estimator.kind == LEVANT:
        state.estimated = estimated(estimator, state.estimated, initialized, position, dt)
        velocity = state.estimated.velocity
    if tracks and not estimator.velocities:
        velocity = np.zeros_like(velocity)
        if kalman.running(memory.torques, when.sample, initialized):
            velocity = memory.kalman.mean.velocity
    blended = approached(
        setup.approach, memory.approach, begun, desired, position, velocity, since
    )
    reference = extrapolated(blended, -late)
    error = position - reference.position
    measured = (
        estimator.kind == NONE or estimator.kind == AGED or (tracks and estimator.velocities)
    )
    comparable = initialized and measured and not gap
    wrong = inconsistent(setup, position, velocity, comparable, dt)
    obeys = delivered.waits or delivered.outage < safety.effort_timeout
    state_fault = select(obeys, wrong, faults.TORQUE_LOST)
    sensed = sense(setup, desired, position, velocity, effort, state_fault, when, since, late)
    zero, place = np.zeros_like(position), np.zeros_like(sensed.model.M)
    if setup.place != NO_PLACE_REQUESTED and sensed.fault == faults.NONE:
        place = place_gradient(setup.locate, setup.robot, setup.place, position, sensed.pose)
    aged = estimator.kind == AGED  # `wanted` is the reference of the moment that the law is told
    wanted, age = select(aged, blended, reference), select(aged, when.age, 0.0)
    feedback = Feedback(position, velocity, excess, zero, place, age)
    tracks = tracks and sensed.model.M[0, 0] > 0.0  # a fault may leave no model
    if tracks:
        reference = extrapolated(blended, estimator.command_delay + estimator.lag)
        motion = kalman.predicted(
            setup,
            sensed.model,
            blended,
            position,
            velocity,
            state.torque,
            delivered.missing,
            initialized,
            when.sample,
            late + estimator.command_delay,
            dt,
        )
        feedback = Feedback(
            motion.position, motion.velocity, excess, motion.disturbance, place, 0.0
        )
        wanted = reference
    # 3. The torque that the law asks for; in a fault it is not called.
    demanded, learned, correction = LawOutput(position, position, position), zero, zero
    repeats = setup.repetition_samples > 0
    if sensed.fault == faults.NONE:
        output = setup.step(setup.law, sensed.model, wanted, feedback, anew, dt)
        unapplied = delivered.outage > 0.0 and not delivered.waits
        demand = output.torque
        if repeats:
            alone = begun == CONTINUES and every(blended.position == desired.position)
            learned = repetition.recalled(
                setup, when.sample, initialized, alone, state.bumpless, desired
            )
            correction = repetition.correction(setup, sensed.model, reference, feedback, demand)
            demand = demand + learned
        torque = select(unapplied, state.torque, demand)
        if identifies:
            torque = torque + lock_in.added(setup, when.sample)
        demanded = LawOutput(torque, output.sliding_variable, output.coupled_error)
    # 4. The same within the limits, or the safe action.
    blind = wrong != faults.NONE
    done, active_limits = act(setup, desired, position, velocity, sensed, blind, demanded, dt)
    state.pose, state.lost, state.begins = sensed.pose, sensed.lost, CONTINUES
    # Also without a filter: a law that comes next may have one.
    recent_torques.record(setup, when.sample, done.torque, learned, tracks)
    if repeats and state.fault == faults.NONE:
        finds = lock_in.phase(setup, when.sample)
        believed = active_limits == 0 and delivered.outage == 0.0 and finds != lock_in.RUNNING
        repetition.learn(setup, when.sample, desired, learned, correction, believed)
    if identifies:
        failed = state.fault != faults.NONE
        lock_in.observe(setup, when.sample, sensed.model, error, done.torque, when.age, failed)
    return Cycle(
        done.torque,
        Telemetry(seen_error, seen_rate, done.coupled_error, done.sliding_variable),
        active_limits + select(delivered.outage >= MIN_OUTAGE, EFFORT, 0),
        sensed.cause,
    )


def cycle_of(setup: Boxed) -> FunctionValue:
    """The cycle of a ControlSetup as a value, so that loops are not compiled with all of it."""
    row = setup.memory.state.fault_position
    reference, when = JointReference(row, row, row), When(0, 0.0, 1e-3)
    return FunctionValue(run_cycle, setup, reference, row, row, row, when)
