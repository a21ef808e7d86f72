"""What a cycle does before and after the law: it looks at the robot, and limits the torque."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.prepared_law import Asked
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.checks import (
    LOOKED_AT,
    SHORT,
    is_resisted,
    too_fast,
    way_to_rest,
)
from parallel_robot_control.safety.limiting import (
    ZERO,
    Last,
    Limits,
    find_fault,
    limit_torque,
    safe_torque,
)
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, is_finite, multiply, select, some
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


@inner
def sense(
    estimate: Any,
    ahead: Any,
    robot: Any,
    limits: Limits,
    reference: JointReference,
    position: Array,
    velocity: Array,
    pose: Array,
    last: Last,
    latched: int,
    doubt: int,
    dt: float,
    since: float,
    late: float,
    lost: bool,
    losing: int,
    memory: Any,
    sample: int,
    acted: Array,
    comparable: bool,
) -> Sensed:
    """Find the pose, look for faults, compute the model.

    Arguments as of :func:`cycle.run_cycle`, and of the state only what counts: a whole one takes
    long to hand over. `doubt` is a fault that torques and states show, `since` the time between
    the moments of the two references [s]. A fault in the motion of the joints comes before that,
    one of the robot after it, one ahead of the robot last. `memory` is that of
    the momentum, `acted` is the torque since the state
    before [N m], and `comparable` whether there was one not long before.
    """
    here = estimate(robot, limits.margins, position, velocity, pose)
    cause = find_fault(limits, reference, position, velocity, last, dt, since)
    cause = select(cause == faults.NONE, doubt, cause)
    cause = select(cause == faults.NONE, here.fault, cause)
    if cause == faults.NONE and way_to_rest(limits, multiply(here.model.M, velocity)) > SHORT:
        fast = too_fast(ahead, robot, limits, position, velocity, here, last, late)
        cause = select(fast, faults.TOO_FAST, faults.NONE)
    if some(np.abs(acted) > LOOKED_AT * limits.residual):
        resisted = is_resisted(
            memory,
            sample,
            limits.residual,
            limits.safe.damping,
            here.model,
            velocity,
            acted,
            comparable,
            dt,
        )
        if resisted and cause == faults.NONE:
            cause = faults.TORQUE_RESISTED
    fault = select(latched == faults.NONE, cause, latched)
    leap = select(limits.speed * dt < LEAP, LEAP, limits.speed * dt)
    leapt = last.known and some(np.abs(position - last.position) > leap)
    lost = lost | ((losing >> here.fault) & 1 != 0) | (leapt and losing != 0)
    return Sensed(cause, fault, here.pose, here.model, lost)


# What becomes of the torque that a law asks for: limited, or replaced by the safe action.


class Limited(NamedTuple):
    """What becomes of what a law asks for; the names are those of Cycle, Last and CycleState."""

    torque: Array
    sliding_variable: Array
    coupled_error: Array
    acted: int
    last: Last
    excess: Array
    held: Array
    fault: int


@inner
def act(
    limits: Limits,
    reference: JointReference,
    position: Array,
    velocity: Array,
    last: Last,
    held: Array,
    latched: int,
    fault: int,
    blind: bool,
    gravity: Array,
    asked: Asked,
    dt: float,
) -> Limited:
    """Limit the torque that the law asks for, or replace it with the safe action.

    Args:
        limits: Limits, safe action and margins.
        reference: Desired joint motion at the state's stamp.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        last: What the cycle before saw and did.
        held: Joint angles at the moment of the fault [rad], shape (n,).
        latched: Fault after the cycle before.
        fault: Fault before the law was asked.
        blind: Whether positions and rates are not to be believed: then nothing is damped.
        gravity: Torque that holds the robot against gravity [N m], shape (n,).
        asked: Output of the law; ignored in a fault.
        dt: Time since the previous state [s].
    """
    demand, sliding_variable, coupled_error = asked
    # 1. A demand that is not finite is a fault, too.
    finite = is_finite(demand)
    fault = select((fault == faults.NONE) & (finite == False), faults.TORQUE_NOT_FINITE, fault)  # noqa: E712
    # 2. In a fault, the safe action replaces the demand; a ramp that is not over is dropped.
    failed = fault != faults.NONE
    new = failed & ((latched == faults.NONE) | (last.known == False))  # noqa: E712
    held = select(new, position, held)
    zero = np.zeros_like(position)
    safe = select(blind, zero, safe_torque(limits.safe, held, position, velocity))
    safe = safe + select(limits.safe.action == ZERO, zero, gravity)
    demand = select(failed, safe, demand)
    sliding_variable = select(failed, zero, sliding_variable)
    coupled_error = select(failed, reference.position - position, coupled_error)
    offset = select(failed, zero, last.offset)
    takes_over = last.takes_over & (fault == faults.NONE)
    last = Last(last.position, last.reference, last.torque, offset, takes_over, last.known)
    # 3. The limits; the next cycle continues from what they let through.
    torque, excess, offset, acted = limit_torque(limits, demand, last, dt)
    last = Last(position, reference.position, torque, offset, False, True)
    return Limited(torque, sliding_variable, coupled_error, acted, last, excess, held, fault)
