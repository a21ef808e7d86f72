"""Limits of torque, its rate and joint speed, and the safe action."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.estimation.lock_in import LockInParameters
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.compiler import as_constants, clip, inline_ir, kernel, select, some

TORQUE, RATE, RAMP, EFFORT, REFERENCE = 1, 2, 4, 8, 16  # bits of the limits that acted
LIMIT_TEXT = {
    TORQUE: 'torque limit',
    RATE: 'torque rate limit',
    RAMP: 'ramp after a take-over',
    EFFORT: 'motors that do not apply the torque',
    REFERENCE: 'no new reference',
}
LIMIT_CODE = {
    TORQUE: 'torque',
    RATE: 'rate',
    RAMP: 'ramp',
    EFFORT: 'effort',
    REFERENCE: 'reference',
}  # in bags: never changed
OVERDUE = 0.1  # s, age of a reference above which it is reported
QUIET = 1.0  # s without limits, after which they are reported anew
ZERO, HOLD = 0, 2  # places of the words of SafetyParameters.action
LEAST = 3.5  # periods, of a gap


def as_limits(parameters: SafetyParameters, period: float) -> Any:
    """Safety parameters as kernels read them: what is not looked at has no limit.

    Args:
        parameters: The parameters.
        period: Control period [s]; a gap between two states is at least LEAST of it.
    """

    def unless_off(tolerance: Any) -> Any:
        return np.where(np.asarray(tolerance) > 0.0, tolerance, np.inf).tolist()

    return as_constants(
        parameters._replace(
            gap=max(parameters.gap, LEAST * period),
            effort_tolerance=unless_off(parameters.effort_tolerance),
            residual_limit=unless_off(parameters.residual_limit),
            rate_tolerance=unless_off(parameters.rate_tolerance),
        )
    )


class When(NamedTuple):
    """Times of a cycle."""

    sample: int  # index of the sample from which on the torque acts
    age: float  # from the measurement of the state to that sample, as the stamps tell [s]
    dt: float  # from the measurement of the state before to that of this one [s]


@kernel
def safe_torque(safety: Any, fault_position: Array, position: Array, velocity: Array) -> Array:
    """Torque of the safe action [N m]: zero, damping, or a spring to `fault_position` as well."""
    damping = -safety.damping * velocity
    torque = select(safety.action == ZERO, np.zeros_like(velocity), damping)
    sprung = torque + safety.stiffness * (fault_position - position)
    torque = select(safety.action == HOLD, sprung, torque)
    return select(torque - torque == 0.0, torque, 0.0)  # zero where it is not finite


@inline_ir
def find_fault(
    safety: Any,
    state: Any,
    reference: JointReference,
    position: Array,
    velocity: Array,
    dt: float,
    since: float,
) -> int:
    """The first fault in the motion of the joints, else NONE.

    Args:
        safety: Limits of torque, rate and speed.
        state: The CycleState after the cycle before.
        reference: Desired joint motion.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        dt: Time since the cycle before [s].
        since: Time between the moments for which the two references are [s].
    """
    reach = safety.speed_limit * dt
    later = safety.speed_limit * select(since > dt, since, dt)
    jumped = state.initialized & (np.abs(position - state.position) > reach)
    led = state.initialized & (np.abs(reference.position - state.reference) > later)
    fault = select(led, faults.REFERENCE_JUMP, faults.NONE)
    fault = select(jumped, faults.POSITION_JUMP, fault)
    fault = select(np.abs(velocity) > safety.speed_limit, faults.SPEED, fault)
    first = fault[0]
    for i in range(1, len(fault)):
        first = select(first == faults.NONE, fault[i], first)
    return first


@inline_ir
def limit_torque(
    safety: Any, demand: Array, state: Any, period: float, dt: float
) -> tuple[Array, Array, Array, int]:
    """Bring a demanded torque within the limits, without a jump when a law takes over.

    A take-over is faded, not rate-limited: the difference between the demand of the new law and
    the last torque is subtracted and fades to zero. So the new law closes its loop from the first
    sample on; a rate limit in the loop would make it oscillate.

    Args:
        safety: Limits of torque, rate and speed.
        demand: Demanded torque [N m], shape (n,).
        state: The CycleState; rates count from its torque, clipped to the limit.
        period: Control period [s]; after a gap, too, the ramp goes on by one.
        dt: Time since the cycle before [s].

    Returns:
        Torque [N m]; excess that the limits cut off [N m]; offset that is still to be faded out
        [N m]; each shape (n,); bits of the limits that acted.
    """
    start = clip(state.torque, -safety.torque_limit, safety.torque_limit)
    # 1. Take-over: offset = demand - start, faded at the ramp rate, sample by sample.
    offset = select(state.bumpless, demand - start, state.offset)
    ramped = some(offset != 0.0)
    remaining = np.abs(offset) - safety.ramp_rate * period
    offset = np.copysign(select(remaining > 0.0, remaining, 0.0), offset)
    wanted = demand - offset
    # 2. Torque limit: |torque| <= limit.
    limited = clip(wanted, -safety.torque_limit, safety.torque_limit)
    # 3. Rate limit: |torque - start| <= rate dt.
    step = limited - start
    fastest = safety.torque_rate * dt
    fast = np.abs(step) > fastest
    torque = select(fast, start + np.copysign(fastest, step), limited)
    active_limits = (
        select(ramped, RAMP, 0)
        + select(some(limited != wanted), TORQUE, 0)
        + select(some(fast), RATE, 0)
    )
    return torque, wanted - torque, offset, active_limits


# Whether the safety limits leave room for the sine of the lock-in.

LIMIT_SHARE = 0.5  # share of a safety limit that the sine may take


def check_lock_in(
    lock_in: LockInParameters,
    safety: Any,
    inertia: Array,
    units: JointUnits = HINGES,
) -> None:
    """Refuse a sine for which the safety limits leave no room.

    Args:
        lock_in: Amplitudes and frequency of the sine.
        safety: Limits of torque, rate and speed.
        inertia: Inertia matrix at the beginning [kg m^2], shape (n, n).
        units: Units of the joints.

    Raises:
        InputError: it takes more than half of a limit.
    """
    torque, frequency = np.asarray(lock_in.torque), 2.0 * math.pi * lock_in.frequency
    speed = np.abs(np.linalg.solve(inertia, torque)) / frequency
    for needed, key, unit in (
        (torque, 'torque_limit', 'N m'),
        (frequency * torque, 'torque_rate', 'N m/s'),
        (speed, 'speed_limit', 'rad/s'),
    ):
        limit = getattr(safety, key)
        over = np.flatnonzero(needed > LIMIT_SHARE * np.asarray(limit))
        if over.size:
            i = int(over[0])
            value = float(torque[i]) * LIMIT_SHARE * float(limit[i]) / float(needed[i])
            word = units.one(i).of
            raise InputError(
                f'lock_in.torque must be at most {value:.3g} {word("N m")} at joint {i + 1}, not '
                f'{torque[i]:g}: it takes {needed[i]:.3g} {word(unit)} of safety.{key}, '
                f'{limit[i]:g}',
                'lock_in.torque',
            )
