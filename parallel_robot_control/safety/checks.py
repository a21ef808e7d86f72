"""What a cycle checks of states and torques, by what the robot does."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.estimation import recent_torques
from parallel_robot_control.estimation.estimator import Observed, observed
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.limiting import (
    ZERO,
    When,
    safe_torque,
)
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    clip,
    every,
    internal,
    kernel,
    largest,
    multiply,
    select,
    solve,
    some,
)
from parallel_robot_model.robots.contract import FOUND, Estimate, Model

# Whether the states say what the robot does: the way of each joint beside the sum of its rates.
#
# Over the last hundredths of a second, the way that a joint went and the integral of its rate must
# agree. A position that does not change at all while the rate goes on, and a rate of exactly zero
# while the position changes, are seen even sooner.

WINDOW = 0.06  # s, time constant with which ways are forgotten
ALIKE = 0.01  # of the tolerance, within which a way and a rate of one state agree
SHARE = 0.5  # of the tolerance, that a single state adds at most: one odd state is no proof
JUMP = 2.0  # tolerances: a single way so much longer than its rate says is a jump
LAG = 0.25  # share of the ways by which they may differ: rates may be filtered


class ConsistencyMemory(NamedTuple):
    """Ways and rates of the last hundredths of a second, as a Struct; each shape (n,) [rad]."""

    differs: bool  # whether they differ at all; if not, what follows does not count
    difference: Array  # ways less integrals of rates
    by_position: Array  # ways
    by_rate: Array  # integrals of the magnitudes of rates
    still: Array  # integral of the rate since the position has not changed
    unsaid: Array  # way since the rate has been zero


@internal
def inconsistent(setup: Any, position: Array, velocity: Array, comparable: bool, dt: float) -> int:
    """The fault of states whose positions and rates contradict each other, else NONE.

    Args:
        setup: The ControlSetup.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        comparable: Whether there was a state not long before, and rates are measured.
        dt: Time since then [s].
    """
    memory, tolerance = setup.memory.consistency, setup.safety.rate_tolerance
    displacement, integrated = position - setup.memory.state.position, dt * velocity
    fresh = not (comparable and memory.differs)
    if comparable and fresh and every(np.abs(displacement - integrated) <= ALIKE * tolerance):
        return faults.NONE
    zero = np.zeros_like(position)
    if fresh:
        memory.difference, memory.by_position, memory.by_rate = zero, zero, zero
        memory.still, memory.unsaid = zero, zero
    memory.differs = comparable
    if not comparable:
        return faults.NONE
    jumped = np.abs(displacement) > JUMP * tolerance + (1.0 + LAG) * np.abs(integrated)
    left, most = WINDOW / (WINDOW + dt), SHARE * tolerance
    displacement, integrated = clip(displacement, -most, most), clip(integrated, -most, most)
    integrated = select(
        integrated - integrated == 0.0, integrated, displacement
    )  # what is not finite is another fault
    apart = left * (memory.difference + displacement - integrated)
    by_position = left * (memory.by_position + np.abs(displacement))
    by_rate = left * (memory.by_rate + np.abs(integrated))
    still = select(displacement == 0.0, memory.still + integrated, zero)
    unsaid = select(integrated == 0.0, memory.unsaid + displacement, zero)
    memory.difference, memory.by_position, memory.by_rate = apart, by_position, by_rate
    memory.still, memory.unsaid = still, unsaid
    wrong = np.abs(apart) > tolerance + LAG * (by_position + by_rate)
    wrong = wrong | (np.abs(unsaid) > tolerance)
    fault = select(some(wrong), faults.VELOCITIES_WRONG, faults.NONE)
    fault = select(some(np.abs(still) > tolerance), faults.POSITIONS_FROZEN, fault)
    fault = select(some(jumped), faults.POSITION_JUMP, fault)
    if every(np.abs(apart) + np.abs(still) + np.abs(unsaid) <= ALIKE * tolerance):
        memory.differs = False
    return fault


# Whether the commanded torque acts: the measured effort of a state beside the commands.
#
# Competing publishers, lost commands, motors that are off, clipped or dead, and brakes have one
# sign in common: the effort is none of the torques that were commanded lately. A command may act
# late, and a motor may lag; then the effort still lies between the commands of the last samples.

LATELY, SOON = 32, 8  # samples within which a command acts; where none has acted yet
MIN_OUTAGE = 0.02  # s of an outage after which it is reported, and its end is a return
PROOF = 2.0  # tolerances of an effort that proves, if it was commanded, that the motors obey
OBEYED, MISSING, FORGETTING, UNPROVEN = range(4)  # what the memory knows of them
FORGETS = 0.5  # s by which a second of obedience shortens an outage: publishers may alternate


class ArrivalMemory(NamedTuple):
    """What is remembered of the torques that arrived, as a Struct."""

    outage: float  # for how long torque has been missing [s]
    motors: int  # OBEYED, MISSING, FORGETTING or UNPROVEN


class Arrival(NamedTuple):
    """What became of the last torque."""

    # torque commanded less torque that acted [N m], shape (n,); zero where it acted
    missing: Array
    outage: float  # for how long torque has been missing [s]; 0 while it acts
    restart: (
        bool  # whether the law begins anew: torque acts again after an outage, or has never acted
    )
    waits: bool  # whether no torque has acted since the start: drives may be enabled late


@internal
def arrival(setup: Any, effort: Array, when: When, initialized: bool, comparable: bool) -> Arrival:
    """Compare the effort that a state tells with the commands of the last samples.

    Args:
        setup: The ControlSetup.
        effort: Torque of the period that ended at the measurement [N m], shape (n,); NaN where it
            is not known.
        when: Times of the cycle.
        initialized: Whether there was a state before.
        comparable: Whether there was one not long before; if not, the measured effort is taken for
            the one that acts.
    """
    memory, torques = setup.memory.arrival, setup.memory.torques
    tolerance, period, dt = setup.safety.effort_tolerance, setup.period, when.dt
    nothing, newest, before = np.zeros_like(effort), torques.newest, memory.motors
    if not comparable or when.sample < newest:  # nothing was commanded lately
        recent_torques.fill(torques, select(effort - effort == 0.0, effort, nothing))
        memory.outage = 0.0
        memory.motors = select(initialized and before != UNPROVEN, OBEYED, UNPROVEN)
        return Arrival(nothing, 0.0, False, False)
    # 1. The usual case: the last command acted.
    last = when.sample - 1
    if when.age > 0.0:
        last -= int(when.age / period + 0.5)
    last = select(last > newest, newest, last)
    commanded, outage = recent_torques.torque_at(torques, last), memory.outage
    differs = some(np.abs(commanded - effort) > tolerance)
    if not differs and before == OBEYED:
        return Arrival(nothing, 0.0, False, False)
    # 2. A late command, or one behind a lag, is none that is missing.
    unproven, missing, lost = before == UNPROVEN, nothing, False
    if differs:
        low, high = commanded, commanded
        for k in range(last - select(unproven and outage > 0.0, SOON, LATELY), newest + 1):
            torque = recent_torques.torque_at(torques, k)
            low, high = select(torque < low, torque, low), select(torque > high, torque, high)
        outside = np.abs(clip(effort, low, high) - effort) > tolerance
        missing = select(outside, commanded - effort, nothing)
        lost = some(outside)
    # 3. How long torque has been missing, and whether any has ever acted.
    step = select(dt < period * LATELY, dt, period)
    waits = unproven and (lost or not some(np.abs(effort) > PROOF * tolerance))
    misses = lost or (waits and outage > 0.0)
    outage = select(misses, outage + step, outage - FORGETS * step)
    outage = select(outage > 0.0, outage, 0.0)
    now = select(lost, MISSING, select(outage > 0.0, FORGETTING, OBEYED))
    memory.outage, memory.motors = outage, select(waits, UNPROVEN, now)
    restart = not misses and outage >= MIN_OUTAGE and (unproven or before == MISSING)
    return Arrival(missing, select(misses, outage, 0.0), restart or (waits and lost), waits)


# Whether torque moves the robot as it should, by the momentum observer.
#
# It finds what efforts do not tell: commands that do not act where no efforts are reported, brakes
# and obstacles, an encoder that stands still while its joint turns.

BANDWIDTH = 20.0  # 1/s
SHARE_OF_EFFECT = (
    0.25  # of the damping of the safe action, times the speed: friction that does not count
)
LASTS = 0.1  # s, for which the residual must be at the limit; twice of it half as long
RECENT_SAMPLES = 32  # samples after which it begins anew
LOOKED_AT = 0.5  # of the limit: a torque from which on the residual is looked at


class MomentumMemory(NamedTuple):
    """What is remembered of the momentum, as a Struct."""

    sample: int  # at which it looked
    observed: Observed
    lasted: float  # for how long the residual was at the limit [s]


@internal
def is_resisted(
    setup: Any, model: Model, velocity: Array, torque: Array, when: When, comparable: bool
) -> bool:
    """Whether much more than friction has acted against the torque: the more, the shorter.

    Args:
        setup: The ControlSetup.
        model: Nominal model at the state; none in a fault of the robot.
        velocity: Measured rates [rad/s], shape (n,).
        torque: Torque since the state before [N m], shape (n,).
        when: Times of the cycle.
        comparable: Whether there was a state not long before.
    """
    memory, safety = setup.memory.momentum, setup.safety
    since = when.sample - memory.sample
    follows = comparable and since >= 0 and since <= RECENT_SAMPLES
    if not model.M[0, 0] > 0.0:
        return False
    now = observed(BANDWIDTH, memory.observed, follows, model, velocity, torque, when.dt)
    memory.observed = now
    level = np.abs(now.residual) - SHARE_OF_EFFECT * safety.damping * np.abs(velocity)
    times = largest(select(level > 0.0, level, np.zeros_like(level)) / safety.residual_limit)
    lasts = select(times > 1.0 and follows, memory.lasted + times * when.dt, 0.0)
    memory.sample, memory.lasted = when.sample, lasts
    return lasts > LASTS


# Whether damping still stops the robot before a fault of its own, as near a singularity.
#
# The way to rest is followed with the nominal robot, whose estimate says where it must not go. It
# is the way under damping alone: the spring of a hold makes it shorter, and no torque at all stops
# nothing.
#
# Source:
#     Gurriet, Mote, Singletary, Nilsson, Feron, Ames (2020), A Scalable Safety Critical Control
#     Framework for Nonlinear Systems, IEEE Access 8: a state is safe from which a backup
#     controller brings the system to rest within its limits.

SHORT = 0.005  # rad, a way to rest that the margins of the robot have room for
RESERVE = 1.25  # by which the robot may be heavier, or the motors weaker
BRAKED = 0.5  # of the momentum in a step, at most
TURNED = 0.1  # of it, by a change of the inertia
STEPS = 32


@kernel
def damping_of(safety: Any, velocity: Array) -> Array:
    """Damping within the torque limit, less the reserve [N m s/rad], shape (n,)."""
    damping, speed = safety.damping, np.abs(velocity)
    within = damping * speed <= safety.torque_limit
    return select(within, damping, safety.torque_limit / speed) / RESERVE


@kernel
def stopping_distance(safety: Any, momentum: Array) -> float:
    """Longest way of a joint to rest, D^-1 M v, with M held and no torque limit [rad]."""
    return largest(momentum / safety.damping)


@internal
def too_fast(
    setup: Any, position: Array, velocity: Array, estimate: Estimate, late: float
) -> bool:
    """Whether the robot could not be brought to rest without a fault of its own.

    M vd + Q v = -D v in steps of the midpoint rule, implicit in D; the model at the middle of one
    begins the next. They are short where the inertia changes fast; a way with too many of them is
    one that goes to a singularity.

    Args:
        setup: The ControlSetup.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        estimate: The estimate there; no fault.
        late: Age of the state [s].
    """
    safety, momentum = setup.safety, multiply(estimate.model.M, velocity)
    if safety.action == ZERO or not every((safety.damping > 0.0) & (safety.torque_limit > 0)):
        return False
    # 1. The motion goes on until the torque has turned round.
    wanted = safe_torque(safety, position, position, velocity)
    turning = largest((wanted - setup.memory.state.torque) / safety.torque_rate)
    position = position + (late + turning) * velocity
    # 2. The way to rest.
    for _ in range(STEPS):
        damping, drift = damping_of(safety, velocity), multiply(estimate.model.Q, velocity)
        size = largest(momentum)
        step = min(
            BRAKED * size / largest(damping * velocity),
            TURNED * size / largest(drift),
        )
        M = estimate.model.M + np.diag((0.5 * step) * damping)
        halfway = solve(M, momentum - (0.5 * step) * drift)
        middle = position + (0.5 * step) * velocity
        estimate = setup.estimate_coarse(
            setup.robot, setup.margins, middle, halfway, estimate.pose
        )
        if estimate.fault != FOUND:
            return True
        damping = damping_of(safety, halfway)
        M = estimate.model.M + np.diag((0.5 * step) * damping)
        lost = multiply(estimate.model.Q, halfway) + damping * velocity
        position = position + step * halfway
        velocity = velocity - step * solve(M, lost)
        momentum = multiply(estimate.model.M, velocity)
        if not stopping_distance(safety, momentum) > SHORT:
            return False
    return True
