"""Whether damping still stops the robot before a fault of its own, as near a singularity.

The way to rest is followed with the nominal robot, whose estimate says where it must not go. It
is the way under damping alone: the spring of a hold makes it shorter, and no torque at all stops
nothing.

Source:
    Gurriet, Mote, Singletary, Nilsson, Feron, Ames (2020), A Scalable Safety Critical Control
    Framework for Nonlinear Systems, IEEE Access 8: a state is safe from which a backup controller
    brings the system to rest within its limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_control.safety.limiting import ZERO, Last, Limits, safe_torque
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import every, inner, kernel, largest, multiply, select, solve
from parallel_robot_model.robots.contract import FOUND, Estimate

SHORT = 0.005  # rad, a way to rest that the margins of the robot have room for
RESERVE = 1.25  # by which the robot may be heavier, or the motors weaker
BRAKED = 0.5  # of the momentum in a step, at most
TURNED = 0.1  # of it, by a change of the inertia
STEPS = 32


@kernel
def damping_of(limits: Limits, velocity: Array) -> Array:
    """Damping within the torque limit, less the reserve [N m s/rad], shape (n,)."""
    damping, speed = limits.safe.damping, np.abs(velocity)
    within = damping * speed <= limits.torque
    return select(within, damping, limits.torque / speed) / RESERVE


@kernel
def way_to_rest(limits: Limits, momentum: Array) -> float:
    """Longest way of a joint to rest, D^-1 M v, with M held and no torque limit [rad]."""
    return largest(momentum / limits.safe.damping)


@inner
def too_fast(
    estimate: Any,
    robot: Any,
    limits: Limits,
    position: Array,
    velocity: Array,
    found: Estimate,
    last: Last,
    late: float,
) -> bool:
    """Whether the robot could not be brought to rest without a fault of its own.

    M vd + Q v = -D v in steps of the midpoint rule, implicit in D; the model at the middle of one
    begins the next. They are short where the inertia changes fast; a way with too many of them is
    one that goes to a singularity.

    Args:
        estimate: Estimate of the robot module for states that are only judged, as FirstClass.
        robot: Constants of the nominal robot.
        limits: Limits, safe action and margins.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        found: The estimate there; no fault.
        last: The cycle before.
        late: Age of the state [s].
    """
    momentum = multiply(found.model.M, velocity)
    if limits.safe.action == ZERO or not every((limits.safe.damping > 0.0) & (limits.torque > 0)):
        return False
    # 1. The motion goes on until the torque has turned round.
    wanted = safe_torque(limits.safe, position, position, velocity)
    turning = largest((wanted - last.torque) / limits.rate)
    position = position + (late + turning) * velocity
    # 2. The way to rest.
    for _ in range(STEPS):
        damping, drift = damping_of(limits, velocity), multiply(found.model.Q, velocity)
        size = largest(momentum)
        step = min(
            BRAKED * size / largest(damping * velocity),
            TURNED * size / largest(drift),
        )
        M = found.model.M + np.diag((0.5 * step) * damping)
        halfway = solve(M, momentum - (0.5 * step) * drift)
        found = estimate(
            robot, limits.margins, position + (0.5 * step) * velocity, halfway, found.pose
        )
        if found.fault != FOUND:
            return True
        damping = damping_of(limits, halfway)
        M = found.model.M + np.diag((0.5 * step) * damping)
        lost = multiply(found.model.Q, halfway) + damping * velocity
        position = position + step * halfway
        velocity = velocity - step * solve(M, lost)
        momentum = multiply(found.model.M, velocity)
        if not way_to_rest(limits, momentum) > SHORT:
            return False
    return True
