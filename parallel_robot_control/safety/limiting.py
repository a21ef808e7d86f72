"""Limits of torque, its rate and joint speed, and the safe action."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.estimation.lock_in import LockIn
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.compiler import clip, inlined, kernel, select, some, vector
from parallel_robot_model.configuration.fields import Field, PerJoint

TORQUE, RATE, RAMP, EFFORT, REFERENCE = 1, 2, 4, 8, 16  # bits of the limits that acted
ACTED_TEXT = {
    TORQUE: 'torque limit',
    RATE: 'torque rate limit',
    RAMP: 'ramp after a take-over',
    EFFORT: 'motors that do not apply the torque',
    REFERENCE: 'no new reference',
}
ACTED_CODE = {
    TORQUE: 'torque',
    RATE: 'rate',
    RAMP: 'ramp',
    EFFORT: 'effort',
    REFERENCE: 'reference',
}  # in bags: never changed
OVERDUE = 0.1  # s, age of a reference above which it is told
QUIET = 1.0  # s without limits, after which they are told anew
ZERO, DAMP, HOLD = 0, 1, 2
LEAST = 3.5  # periods, of a gap
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
    state_age: Annotated[
        float, Field('s', 'age from which on a state is not answered (wall time)', 1e-3)
    ]
    gap: Annotated[
        float, Field('s', 'time between two states after which the law begins anew', 1e-3)
    ]
    effort_tolerance: Annotated[
        PerJoint,
        Field('N m', 'efforts so far from all late commands do not obey; 0: not looked at', 0.0),
    ]
    effort_timeout: Annotated[float, Field('s', 'time without obedience that is a fault', 1e-3)]
    residual_limit: Annotated[
        PerJoint,
        Field('N m', 'torque beside friction that resists the motors; 0: not looked at', 0.0),
    ]
    rate_tolerance: Annotated[
        float,
        Field('rad', 'by which ways may differ from integrals of rates; 0: not looked at', 0.0),
    ]


class SafeAction(NamedTuple):
    """Torque after a fault: ZERO, DAMP or HOLD; damping and stiffness, each shape (n,)."""

    action: int
    damping: Array
    stiffness: Array


class Limits(NamedTuple):
    """The parameters as the kernels take them: vectors of shape (n,), margins of the robot.

    `ramp` is for one sample [N m]: a gap between two states must not let the torque jump.
    """

    safe: SafeAction
    torque: Array
    rate: Array
    ramp: Array
    speed: Array
    gap: float
    effort_tolerance: Array
    effort_timeout: float
    residual: Array
    rate_tolerance: float
    margins: Any


def safe_action(action: str, parameters: SafetyParameters) -> SafeAction:
    """The safe action with this name, with the gains of the parameters."""
    return SafeAction(ACTIONS[action], vector(parameters.damping), vector(parameters.stiffness))


def limits_of(parameters: SafetyParameters, margins: Any, period: float) -> Limits:
    """Make the limits from the parameters; `margins` are of the robot, the `period` in s."""
    return Limits(
        safe_action(parameters.action, parameters),
        vector(parameters.torque_limit),
        vector(parameters.torque_rate),
        vector(np.asarray(parameters.ramp_rate) * period),
        vector(parameters.speed_limit),
        max(parameters.gap, LEAST * period),
        vector(_unless_off(parameters.effort_tolerance)),
        parameters.effort_timeout,
        vector(_unless_off(parameters.residual_limit)),
        float(_unless_off(parameters.rate_tolerance)),
        margins,
    )


def _unless_off(tolerance: Any) -> Array:
    """Tolerances, infinite where they are 0."""
    given = np.asarray(tolerance)
    return np.where(given > 0.0, given, np.inf)


class Last(NamedTuple):
    """Measurements and output of the cycle before, each shape (n,)."""

    position: Array  # measured angles [rad]
    reference: Array  # desired angles [rad]
    torque: Array  # torque applied [N m]
    offset: Array  # subtracted from the demanded torque; fades to zero after a take-over [N m]
    takes_over: bool  # whether the next torque must continue from `torque`
    known: bool  # whether `position` and `reference` were measured


@kernel
def safe_torque(safe: SafeAction, held: Array, position: Array, velocity: Array) -> Array:
    """Torque of the safe action: zero, damping, or also stiffness to `held` [N m], shape (n,)."""
    damping = -safe.damping * velocity
    torque = select(safe.action == ZERO, np.zeros_like(velocity), damping)
    sprung = torque + safe.stiffness * (held - position)
    torque = select(safe.action == HOLD, sprung, torque)
    return select(torque - torque == 0.0, torque, 0.0)  # zero where it is not finite


@inlined
def find_fault(
    limits: Limits,
    reference: JointReference,
    position: Array,
    velocity: Array,
    last: Last,
    dt: float,
    since: float,
) -> int:
    """The first fault in the motion of the joints, else NONE.

    Args:
        limits: Limits of torque, rate and speed.
        reference: Desired joint motion.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        last: The cycle before.
        dt: Time since the cycle before [s].
        since: Time between the moments for which the two references are [s].
    """
    reach = limits.speed * dt
    later = limits.speed * select(since > dt, since, dt)
    jumped = last.known & (np.abs(position - last.position) > reach)
    led = last.known & (np.abs(reference.position - last.reference) > later)
    fault = select(led, faults.REFERENCE_JUMP, faults.NONE)
    fault = select(jumped, faults.POSITION_JUMP, fault)
    fault = select(np.abs(velocity) > limits.speed, faults.SPEED, fault)
    first = fault[0]
    for i in range(1, len(fault)):
        first = select(first == faults.NONE, fault[i], first)
    return first


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
    start = clip(last.torque, -limits.torque, limits.torque)
    # 1. Take-over: offset = demand - start, faded at the ramp rate, sample by sample.
    offset = select(last.takes_over, demand - start, last.offset)
    ramped = some(offset != 0.0)
    left = np.abs(offset) - limits.ramp
    offset = np.copysign(select(left > 0.0, left, 0.0), offset)
    wanted = demand - offset
    # 2. Torque limit: |torque| <= limit.
    limited = clip(wanted, -limits.torque, limits.torque)
    # 3. Rate limit: |torque - start| <= rate dt.
    step = limited - start
    fastest = limits.rate * dt
    fast = np.abs(step) > fastest
    torque = select(fast, start + np.copysign(fastest, step), limited)
    acted = (
        select(ramped, RAMP, 0)
        + select(some(limited != wanted), TORQUE, 0)
        + select(some(fast), RATE, 0)
    )
    return torque, wanted - torque, offset, acted


# Whether the safety limits leave room for the sine of the lock-in.

LIMIT_SHARE = 0.5  # share of a safety limit that the sine may take


def check_lock_in(
    lock_in: LockIn, limits: Limits, inertia: Array, units: JointUnits = HINGES
) -> None:
    """Refuse a sine for which the safety limits leave no room.

    Args:
        lock_in: The lock-in.
        limits: Limits of torque, rate and speed.
        inertia: Inertia matrix at the beginning [kg m^2], shape (n, n).
        units: Units of the joints.

    Raises:
        InputError: it takes more than half of a limit.
    """
    torque, frequency = np.asarray(lock_in.torque), lock_in.frequency
    speed = np.abs(np.linalg.solve(inertia, torque)) / frequency
    for takes, limit, key, unit in (
        (torque, limits.torque, 'torque_limit', 'N m'),
        (frequency * torque, limits.rate, 'torque_rate', 'N m/s'),
        (speed, limits.speed, 'speed_limit', 'rad/s'),
    ):
        over = np.flatnonzero(takes > LIMIT_SHARE * np.asarray(limit))
        if over.size:
            i = int(over[0])
            value = float(torque[i]) * LIMIT_SHARE * float(limit[i]) / float(takes[i])
            told = units.one(i).of
            raise InputError(
                f'lock_in.torque must be at most {value:.3g} {told("N m")} at joint {i + 1}, not '
                f'{torque[i]:g}: it takes {takes[i]:.3g} {told(unit)} of safety.{key}, '
                f'{limit[i]:g}',
                'lock_in.torque',
            )
