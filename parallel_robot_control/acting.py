"""What becomes of the torque that a law asks for: limited, or replaced by the safe action."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.prepared_laws.law_step import Asked
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.limiting import ZERO, Last, Limits, limit_torque, safe_torque
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, is_finite, select


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
