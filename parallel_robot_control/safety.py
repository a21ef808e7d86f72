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

TORQUE, RATE, RAMP = 1, 2, 4  # bits of what acted
ACTED_TEXT = {TORQUE: 'torque limit', RATE: 'torque rate limit', RAMP: 'ramp after a take-over'}
ACTED_CODE = {TORQUE: 'torque', RATE: 'rate', RAMP: 'ramp'}  # in bags: never changed
ZERO, DAMP, HOLD = 0, 1, 2
ACTIONS = {'zero': ZERO, 'damp': DAMP, 'hold': HOLD}


class SafetyParameters(NamedTuple):
    """What the controller never exceeds, and what it does instead of its law after a fault."""

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
    """The parameters as the kernels take them; arrays have shape (n,), margins are the robot's."""

    safe: SafeAction
    torque: Array
    rate: Array
    ramp: Array
    speed: Array
    margins: Any


def safe_action(action: str, parameters: SafetyParameters) -> SafeAction:
    """The safe action of a name, with the gains of the parameters."""
    return SafeAction(
        ACTIONS[action], np.array(parameters.damping), np.array(parameters.stiffness)
    )


def limits_of(parameters: SafetyParameters, margins: Any) -> Limits:
    """Take the numbers out of the parameters; `margins` are SafetyMargins of the robot."""
    return Limits(
        safe_action(parameters.action, parameters),
        np.array(parameters.torque_limit),
        np.array(parameters.torque_rate),
        np.array(parameters.ramp_rate),
        np.array(parameters.speed_limit),
        margins,
    )


class Last(NamedTuple):
    """What the cycle before saw and did, each shape (n,).

    Attributes:
        position: Measured angles [rad].
        reference: Desired angles [rad].
        torque: Torque applied [N m].
        offset: What is taken off the demanded torque until a take-over is faded out [N m].
        takes_over: Whether the next torque has to go on from `torque`.
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
    """Torque that brings the joints to rest, or to rest where they were held [N m], shape (n,)."""
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
        limits: See SafetyParameters.
        reference: Desired joint motion.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        last: The cycle before.
        dt: Time since then [s].
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

    A take-over is faded, not rate-limited: what the new law asks for more than the torque before
    is taken off, less and less of it. So the law has its loop from the first sample on; a rate
    limit in the loop would make it swing.

    Args:
        limits: See SafetyParameters.
        demand: [N m], shape (n,).
        last: The cycle before; its torque, within the limit, is where the rates start.
        dt: Time since then [s].

    Returns:
        Torque [N m]; what of the demand the limits cut off [N m]; offset that is still to be faded
        out [N m]; each shape (n,); bits of what acted.
    """
    n = len(demand)
    torque, excess, offset = np.empty(n), np.empty(n), np.empty(n)
    acted = 0
    for i in range(n):
        start = min(max(last.torque[i], -limits.torque[i]), limits.torque[i])
        offset[i] = last.offset[i]
        if last.takes_over:
            offset[i] = demand[i] - start
        fade = limits.ramp[i] * dt
        if offset[i] != 0.0:
            acted |= RAMP
        offset[i] = np.copysign(max(abs(offset[i]) - fade, 0.0), offset[i])
        wanted = demand[i] - offset[i]
        torque[i] = min(max(wanted, -limits.torque[i]), limits.torque[i])
        if torque[i] != wanted:
            acted |= TORQUE
        step = torque[i] - start
        fastest = limits.rate[i] * dt
        if abs(step) > fastest:
            torque[i] = start + np.copysign(fastest, step)
            acted |= RATE
        excess[i] = wanted - torque[i]
    return torque, excess, offset, acted
