"""What a cycle knows of the robot: its pose, its model, and the faults that they show."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.braking import SHORT, too_fast, way_to_rest
from parallel_robot_control.safety.limiting import Last, Limits, find_fault
from parallel_robot_control.safety.torque_effect import LOOKED_AT, is_resisted
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, multiply, select, some
from parallel_robot_model.robots.contract import Model

LEAP = 0.05  # rad, of a joint between two states, after which nobody knows how the robot got there


class Sensed(NamedTuple):
    """What a cycle knows of the robot.

    Attributes:
        cause: Fault whose cause is there now, else NONE.
        fault: The latched fault, else the cause.
        pose: Pose, shape (m,).
        model: Equations of motion; zero where the robot has none.
        lost: Whether the pose is lost: the robot may be in another assembly mode.
    """

    cause: int
    fault: int
    pose: Array
    model: Model
    lost: bool


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
    memory: int,
    sample: int,
    acted: Array,
    comparable: bool,
) -> Sensed:
    """Find the pose, look for faults, compute the model.

    Arguments as of :func:`cycle.run_cycle`, and of the state only what counts: a whole one takes
    long to hand over. `doubt` is a fault that torques and states show, `since` the time between
    the moments of the two references [s]. A fault in the motion of the joints comes before that,
    one of the robot after it, one ahead of the robot last. `acted` is the torque since the state
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
