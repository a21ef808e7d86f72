"""Limits of torque, its rate and joint speed, and the safe action."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.fields import Field, PerJoint
from parallel_robot_base.kernel import inlined, kernel
from parallel_robot_control import faults
from parallel_robot_control.contract import JointReference

Array = NDArray[np.float64]

TORQUE, RATE, RAMP = 1, 2, 4  # bits of the limits that acted
ACTED_TEXT = {TORQUE: 'torque limit', RATE: 'torque rate limit', RAMP: 'ramp after a take-over'}
ACTED_CODE = {TORQUE: 'torque', RATE: 'rate', RAMP: 'ramp'}  # in bags: never changed
ZERO, DAMP, HOLD = 0, 1, 2
ACTIONS = {'zero': ZERO, 'damp': DAMP, 'hold': HOLD}


class SafetyParameters(NamedTuple):
    """Limits of the controller, and what replaces its law after a fault."""

    action: Annotated[
        Literal['zero', 'damp', 'hold'],
        Field('', 'after a fault: no torque, damping, or spring and damping'),
    ]
    damping: Annotated[PerJoint, Field('N m s/rad', 'damping of damp and hold', 0.0)]
    stiffness: Annotated[PerJoint, Field('N m/rad', 'spring of hold', 0.0)]
    torque_limit: Annotated[PerJoint, Field('N m', 'largest torque per joint', 0.0)]
    torque_rate: Annotated[
        PerJoint, Field('N m/s', 'fastest change of the torque per joint', 1e-3)
    ]
    ramp_rate: Annotated[
        PerJoint, Field('N m/s', 'how fast the torque before a take-over is faded out', 1e-3)
    ]
    speed_limit: Annotated[PerJoint, Field('rad/s', 'joint speed that is a fault', 0.0)]
    state_timeout: Annotated[
        float, Field('s', 'time without joint states that is a fault (wall time)', 1e-3)
    ]
    reference_timeout: Annotated[
        float, Field('s', 'age of the reference at a state that is a fault', 1e-3)
    ]


class SafeAction(NamedTuple):
    """Torque after a fault: ZERO, DAMP or HOLD; damping and stiffness, each shape (n,)."""

    action: int
    damping: Array
    stiffness: Array


class Limits(NamedTuple):
    """The parameters as the kernels take them: arrays of shape (n,), margins of the robot."""

    safe: SafeAction
    torque: Array
    rate: Array
    ramp: Array
    speed: Array
    margins: Any


def safe_action(action: str, parameters: SafetyParameters) -> SafeAction:
    """The safe action with this name, with the gains of the parameters."""
    return SafeAction(
        ACTIONS[action], np.array(parameters.damping), np.array(parameters.stiffness)
    )


def limits_of(parameters: SafetyParameters, margins: Any) -> Limits:
    """Make the limits from the parameters; `margins` are SafetyMargins of the robot."""
    return Limits(
        safe_action(parameters.action, parameters),
        np.array(parameters.torque_limit),
        np.array(parameters.torque_rate),
        np.array(parameters.ramp_rate),
        np.array(parameters.speed_limit),
        margins,
    )


class Last(NamedTuple):
    """Measurements and output of the cycle before, each shape (n,).

    Attributes:
        position: Measured angles [rad].
        reference: Desired angles [rad].
        torque: Torque applied [N m].
        offset: Subtracted from the demanded torque; fades to zero after a take-over [N m].
        takes_over: Whether the next torque must continue from `torque`.
        known: Whether `position` and `reference` were measured.
    """

    position: Array
    reference: Array
    torque: Array
    offset: Array
    takes_over: bool
    known: bool


@kernel
def safe_torque(safe: SafeAction, held: Array, position: Array, velocity: Array) -> Array:
    """Torque of the safe action: zero, damping, or also stiffness to `held` [N m], shape (n,)."""
    torque = np.zeros(len(position))
    for i in range(len(position)):
        if safe.action != ZERO:
            torque[i] = -safe.damping[i] * velocity[i]
        if safe.action == HOLD:
            torque[i] += safe.stiffness[i] * (held[i] - position[i])
        if not np.isfinite(torque[i]):
            torque[i] = 0.0
    return torque


@inlined
def find_fault(
    limits: Limits,
    reference: JointReference,
    position: Array,
    velocity: Array,
    last: Last,
    dt: float,
) -> int:
    """The first fault in the motion of the joints, else NONE.

    Args:
        limits: Limits of torque, rate and speed.
        reference: Desired joint motion.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        last: The cycle before.
        dt: Time since the cycle before [s].
    """
    for i in range(len(position)):
        if abs(velocity[i]) > limits.speed[i]:
            return faults.SPEED
        reach = limits.speed[i] * dt
        if last.known and abs(position[i] - last.position[i]) > reach:
            return faults.POSITION_JUMP
        if last.known and abs(reference.position[i] - last.reference[i]) > reach:
            return faults.REFERENCE_JUMP
    return faults.NONE


@inlined
def limit_torque(
    limits: Limits, demand: Array, last: Last, dt: float
) -> tuple[Array, Array, Array, int]:
    """Bring a demanded torque within the limits, without a jump when a law takes over.

    A take-over is faded, not rate-limited: the difference between the demand of the new law and
    the last torque is subtracted and fades to zero. So the new law closes its loop from the first
    sample on; a rate limit in the loop would make it oscillate.

    Args:
        limits: Limits of torque, rate and speed.
        demand: Demanded torque [N m], shape (n,).
        last: The cycle before; rates count from its torque, clipped to the limit.
        dt: Time since the cycle before [s].

    Returns:
        Torque [N m]; excess that the limits cut off [N m]; offset that is still to be faded out
        [N m]; each shape (n,); bits of the limits that acted.
    """
    n = len(demand)
    torque, excess, offset = np.empty(n), np.empty(n), np.empty(n)
    acted = 0
    for i in range(n):
        start = min(max(last.torque[i], -limits.torque[i]), limits.torque[i])
        # 1. Take-over: offset = demand - start, faded at the ramp rate.
        offset[i] = last.offset[i]
        if last.takes_over:
            offset[i] = demand[i] - start
        fade = limits.ramp[i] * dt
        if offset[i] != 0.0:
            acted |= RAMP
        offset[i] = np.copysign(max(abs(offset[i]) - fade, 0.0), offset[i])
        wanted = demand[i] - offset[i]
        # 2. Torque limit: |torque| <= limit.
        torque[i] = min(max(wanted, -limits.torque[i]), limits.torque[i])
        if torque[i] != wanted:
            acted |= TORQUE
        # 3. Rate limit: |torque - start| <= rate dt.
        step = torque[i] - start
        fastest = limits.rate[i] * dt
        if abs(step) > fastest:
            torque[i] = start + np.copysign(fastest, step)
            acted |= RATE
        excess[i] = wanted - torque[i]
    return torque, excess, offset, acted
