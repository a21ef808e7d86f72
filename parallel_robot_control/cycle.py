"""One control cycle: kinematics, faults, law, limits; the same kernel with and without ROS."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control import repetition
from parallel_robot_control.approach import (
    BACK,
    GOES_ON,
    START,
    approach_memory,
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
from parallel_robot_control.prepared_law import Asked
from parallel_robot_control.reference_buffer import moved_on
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.checks import (
    TOLD,
    arrival,
    arrival_memory,
    inconsistent,
    momentum_memory,
    ways_memory,
)
from parallel_robot_control.safety.limiting import EFFORT, Last, When
from parallel_robot_control.sense_and_act import act, sense
from parallel_robot_control.terms import NO_PLACE, place_gradient
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    Boxed,
    FirstClass,
    Struct,
    every,
    inner,
    kernel,
    select,
    vector,
)


class CycleState(NamedTuple):
    """What one cycle hands to the next."""

    pose: Array  # pose by forward kinematics, shape (m,); the guess for the next one
    last: Last  # what the cycle saw and did
    excess: Array  # torque of the law that the limits cut off [N m], shape (n,)
    held: Array  # joint angles at the moment of the fault [rad], shape (n,)
    fault: int  # NONE or the number of the fault, see faults.py; it is latched
    estimated: Estimated  # estimates of filter and differentiator; not used without one
    begins: int  # what the next cycle begins: GOES_ON, START or BACK
    # whether the pose may be that of another assembly mode, see assembly_mode.py; it is latched
    lost: bool


class CycleMemory(NamedTuple):
    """What the cycle remembers besides its state; laws that follow each other share it."""

    torques: Any  # RecentTorques; it and all that follows as a Struct
    kalman: Any  # KalmanMemory
    lock_in: Any  # LockInMemory
    approach: Any  # ApproachMemory
    ways: Any  # WaysMemory
    arrival: Any  # ArrivalMemory
    momentum: Any  # MomentumMemory
    repetition: Any  # RepetitionMemory


def cycle_memory(joints: int, repetition_memory: Struct) -> Struct:
    """Memory before the first state; `repetition_memory`: what is remembered of turns."""
    zero = vector(np.zeros(joints))
    return Struct(
        CycleMemory(
            recent_torques.recent_torques(zero),
            kalman.kalman_memory(zero),
            lock_in.lock_in_memory(zero),
            approach_memory(zero),
            ways_memory(zero),
            arrival_memory(),
            momentum_memory(zero),
            repetition_memory,
        )
    )


class ControlSetup(NamedTuple):
    """The constant parts of a controller, boxed; parameters as :func:`as_constants`."""

    step: Any  # step of the law, as FirstClass
    estimate: Any  # estimate of the robot module, as FirstClass
    ahead: Any  # the same for states that are only judged, as FirstClass
    locate: Any  # its forward kinematics, as FirstClass
    law: Any  # the law itself, an address; of one type for all laws
    place: int  # number of the coordinates of the place that the law asks for, see terms.py
    has_model: bool  # whether the law adds what the model knows, see repetition.py
    robot: Any  # constants of the nominal robot, boxed
    margins: Any  # its SafetyMargins
    losing: int  # its faults at which it has no pose, as bits
    period: float  # of the samples [s]
    turn: int  # samples of a turn from which the next one learns; 0: nothing is learned
    identifies: bool  # whether the age of the states is identified
    safety: Any  # SafetyParameters, boxed, as all that follow; see as_limits
    estimator: Any  # EstimatorParameters, settled
    lock_in: Any  # LockInParameters
    approach: Any  # ApproachParameters
    repetition: Any  # RepetitionParameters but for the period of a turn
    memory: Any  # CycleMemory, a Struct


class Cycle(NamedTuple):
    """Result of one control cycle."""

    torque: Array  # commanded torque [N m], shape (n,)
    sliding_variable: Array  # sliding variable in the law's unit, shape (n,); zero in a fault
    coupled_error: Array  # e_c [rad], shape (n,); e in a fault
    acted: int  # bits of the limits that acted
    cause: int  # fault whose cause is there now, else NONE; `state` has the one that is latched
    state: CycleState  # state of the controller for the next cycle


def initial_state(pose: Array, joints: int) -> CycleState:
    """State before the first cycle: no torque, and the first one is not ramped.

    Args:
        pose: Pose from which the forward kinematics starts, shape (m,).
        joints: Number of the actuated joints, n.
    """
    zero = vector(np.zeros(joints))
    last = Last(zero, zero, zero, zero, False, False)
    return CycleState(
        vector(pose),
        last,
        zero,
        zero,
        faults.NONE,
        Estimated(zero, zero),
        START,
        False,
    )


@inner
def taking_over(last: Last, effort: Array) -> Last:
    """The cycle before, for a law that begins anew: its torque goes on from what acts [N m]."""
    torque = select(effort - effort == 0.0, effort, last.torque)
    zero = np.zeros_like(torque)
    return Last(last.position, last.reference, torque, zero, True, last.known)


@inner
def before_cycle(state: CycleState, torque: Array, cause: int, joins: bool) -> CycleState:
    """The state with which a cycle begins.

    Args:
        state: State after the cycle before.
        torque: Torque that acts [N m], shape (n,).
        cause: STATES_STALE or REFERENCE_STALE if one of them stayed away for too long, else NONE.
        joins: Whether the law begins anew, see controller_state.joining.
    """
    last, fault, held = state.last, state.fault, state.held
    excess, takes_over, begins = state.excess, last.takes_over, state.begins
    if fault == faults.NONE and cause != faults.NONE:
        fault, held = cause, last.position
    if joins:
        excess, takes_over, begins = np.zeros_like(excess), True, BACK
    return CycleState(
        state.pose,
        Last(last.position, last.reference, torque, last.offset, takes_over, last.known),
        excess,
        held,
        fault,
        state.estimated,
        begins,
        state.lost,
    )


@kernel
def run_cycle(
    setup: Any,
    desired: JointReference,
    position: Array,
    velocity: Array,
    effort: Array,
    state: CycleState,
    when: When,
) -> Cycle:
    """Compute the torque for one joint state.

    A state may be old. The law compares it with the reference of the moment at which it was
    measured, or knows its age; or with a Kalman filter the motion predicted for the moment at
    which the torque acts with the reference of that moment.

    The memories of the law, which is not called in a fault, and of the cycle are written in place.

    Args:
        setup: The ControlSetup, boxed.
        desired: Desired joint motion at the sample from which on the torque acts.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        effort: Torque applied during the step that ended at the measurement [N m], shape (n,); NaN
            where it is not known.
        state: State of the controller after the cycle before.
        when: Age of the state, time since the one before.
    """
    safety, estimator, memory, dt = setup.safety, setup.estimator, setup.memory, when.dt
    position = position - estimator.zero_angle
    known, identifies = state.last.known, setup.identifies
    if identifies:
        lock_in.begin(setup, when.sample, known, state.fault != faults.NONE)
    tracks, late = estimator.kind == KALMAN, when.age + lock_in.delay_at(setup, known)
    # 1. Whether the last torque acted. After a gap, or when it acts again, the law begins anew.
    gap, last, begun = known and dt > safety.gap, state.last, state.begins
    told = arrival(setup, effort, when, known, known and not gap)
    excess, anew = state.excess + told.missing, False
    if (gap or told.back) and state.fault == faults.NONE:
        last, begun, anew = taking_over(last, effort), BACK, True
        excess = np.zeros_like(excess)
    if begun == BACK:
        memory.torques.tracked = False
    since = dt
    if tracks:
        since = recent_torques.between(memory.torques, when.age, known, dt)
    # 2. Velocity, reference, pose, model and faults of the robot.
    found = state.estimated
    if estimator.kind == FILTER or estimator.kind == LEVANT:
        found = estimated(estimator, state.estimated, known, position, dt)
        velocity = found.velocity
    if tracks and not estimator.velocities:
        velocity = np.zeros_like(velocity)
        if kalman.running(memory.torques, when.sample, known):
            velocity = memory.kalman.mean.velocity
    joined = approached(setup.approach, memory.approach, begun, desired, position, velocity, since)
    reference = moved_on(joined, -late)
    error = position - reference.position
    measured = (
        estimator.kind == NONE or estimator.kind == AGED or (tracks and estimator.velocities)
    )
    comparable = known and measured and not gap
    wrong = inconsistent(setup, position, velocity, last.position, comparable, dt)
    obeys = told.waits or told.spell < safety.effort_timeout
    doubt = select(obeys, wrong, faults.TORQUE_LOST)
    sensed = sense(
        setup, state, last, desired, position, velocity, effort, doubt, when, since, late
    )
    zero, place = np.zeros_like(position), np.zeros_like(sensed.model.M)
    if setup.place != NO_PLACE and sensed.fault == faults.NONE:
        place = place_gradient(setup.locate, setup.robot, setup.place, position, sensed.pose)
    feedback, wanted = Feedback(position, velocity, excess, zero, place, 0.0), reference
    if estimator.kind == AGED:
        feedback, wanted = Feedback(position, velocity, excess, zero, place, when.age), joined
    tracks = tracks and sensed.model.M[0, 0] > 0.0  # a fault may leave no model
    if tracks:
        reference = moved_on(joined, estimator.command_delay + estimator.lag)
        motion = kalman.predicted(
            setup,
            sensed.model,
            joined,
            position,
            velocity,
            last.torque,
            told.missing,
            known,
            when.sample,
            late + estimator.command_delay,
            dt,
        )
        feedback = Feedback(
            motion.position, motion.velocity, excess, motion.disturbance, place, 0.0
        )
        wanted = reference
    # 3. The torque that the law asks for; in a fault it is not called.
    asked, learned, correction = Asked(position, position, position), zero, zero
    repeats = setup.turn > 0
    if sensed.fault == faults.NONE:
        output = setup.step(setup.law, sensed.model, wanted, feedback, anew, dt)
        in_vain = told.spell > 0.0 and not told.waits
        demand = output.torque
        if repeats:
            alone = begun == GOES_ON and every(joined.position == desired.position)
            learned = repetition.recalled(
                setup, when.sample, known, alone, last.takes_over, desired
            )
            correction = repetition.correction(setup, sensed.model, reference, feedback, demand)
            demand = demand + learned
        torque = select(in_vain, last.torque, demand)
        if identifies:
            torque = torque + lock_in.added(setup, when.sample)
        asked = Asked(torque, output.sliding_variable, output.coupled_error)
    # 4. The same within the limits, or the safe action.
    blind = wrong != faults.NONE
    done = act(setup, state, last, desired, position, velocity, sensed, blind, asked, dt)
    # Also without a filter: a law that comes next may have one.
    recent_torques.remember(setup, when.sample, done.torque, learned, tracks)
    if repeats and done.fault == faults.NONE:
        finds = lock_in.phase(setup, when.sample)
        believed = done.acted == 0 and told.spell == 0.0 and finds != lock_in.UNDER_WAY
        repetition.learn(setup, when.sample, desired, learned, correction, believed)
    if identifies:
        failed = done.fault != faults.NONE
        lock_in.observe(setup, when.sample, sensed.model, error, done.torque, when.age, failed)
    return Cycle(
        done.torque,
        done.sliding_variable,
        done.coupled_error,
        done.acted + select(told.spell >= TOLD, EFFORT, 0),
        sensed.cause,
        CycleState(
            sensed.pose,
            done.last,
            done.excess,
            done.held,
            done.fault,
            found,
            GOES_ON,
            sensed.lost,
        ),
    )


def cycle_of(setup: Boxed, state: CycleState) -> FirstClass:
    """The cycle as a value, so that loops are not compiled with all of it inside.

    Args:
        setup: The ControlSetup.
        state: State of the controller.
    """
    row = state.held
    reference, when = JointReference(row, row, row), When(0, 0.0, 1e-3)
    return FirstClass(run_cycle, setup, reference, row, row, row, state, when)
