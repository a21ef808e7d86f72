"""State of a controller between two cycles: when the motion starts, faults, lost joint states."""

from __future__ import annotations

import numpy as np

from parallel_robot_control.approach import BACK
from parallel_robot_control.cycle import CycleState, initial_state
from parallel_robot_control.prepared_law import PreparedLaw
from parallel_robot_control.safety import faults
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import vector

# What happens to a controller between two cycles: faults, clearing, switching, a new run.
#
# The live controller and the replay of a bag both use these, so they cannot disagree.


def joining(state: CycleState, torque: Array) -> CycleState:
    """Let the law begin anew: torque as of :func:`taking_over`, an approach from where it is."""
    return taking_over(state, torque)._replace(begins=BACK)


def taking_over(state: CycleState, torque: Array) -> CycleState:
    """Let the next torque continue from `torque` [N m], shape (n,); from 0 if not finite."""
    known = vector(np.where(np.isfinite(torque), torque, 0.0))
    return state._replace(
        last=state.last._replace(torque=known, takes_over=True), excess=vector(0.0 * known)
    )


def rejoined(state: CycleState) -> CycleState:
    """References are there again: an approach to them, torque from the last one."""
    return joining(state, state.last.torque)


def tripped(state: CycleState, fault: int) -> CycleState:
    """Enter a fault, unless the controller already is in one."""
    if state.fault != faults.NONE:
        return state
    return state._replace(fault=fault, held=state.last.position)


def without_torque(state: CycleState) -> CycleState:
    """The state after zero torque was sent because no joint states can be trusted."""
    return state._replace(last=state.last._replace(torque=vector(np.zeros(len(state.held)))))


def cleared(state: CycleState) -> CycleState:
    """Leave a fault: an empty memory of the law, torque from the last one, a new approach."""
    if state.fault == faults.NONE:
        return state
    return joining(state, state.last.torque)._replace(fault=faults.NONE)


def placed(state: CycleState, pose: Array) -> CycleState:
    """Know the pose, shape (m,), or one near it on the same assembly mode."""
    return state._replace(pose=vector(pose), lost=False)


def same(before: PreparedLaw, after: PreparedLaw) -> bool:
    """Whether a change of law and gains changes nothing."""
    return bool((after.name, after.gains) == (before.name, before.gains))


def switched(state: CycleState, before: PreparedLaw, after: PreparedLaw) -> CycleState:
    """Change law or gains; the torque continues from the last one, if there is one.

    A law that becomes active starts with an empty memory; new gains of the active law keep its
    memory.

    Args:
        state: State of the controller.
        before: The previous law.
        after: The law from now on; its memory is made what it then is.
    """
    if after.name != before.name:
        after.reset_memory()
    elif after.memory is not before.memory:
        after.memory.current = before.memory.current
    if state.last.known and not same(before, after):
        state = taking_over(state, state.last.torque)
    return state


def restarted(state: CycleState, guess: Array) -> CycleState:
    """The state before a new run of the plant; a fault, and a pose that is lost, stay so.

    `guess`: its pose, shape (m,).
    """
    begun = initial_state(guess, len(state.held))
    return begun._replace(fault=state.fault, lost=state.lost)
