"""What happens to a controller between two cycles: faults, clearing, switching, a new run.

The live controller, the simulation and the replay of a bag all use these, so they cannot disagree.
Each changes a CycleState, a Struct.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_control import cycle
from parallel_robot_control.prepared_law import PreparedLaw
from parallel_robot_control.safety import faults
from parallel_robot_model.common.units import Array

join, trip = cycle.join.py_func, cycle.trip.py_func  # type: ignore[attr-defined]


def rejoin(state: Any) -> None:
    """References are there again: an approach to them, torque from the last one."""
    join(state, state.torque)


def drop_torque(state: Any) -> None:
    """Zero torque was sent because no joint states can be trusted."""
    state.torque = np.zeros(len(state.fault_position))


def clear(state: Any) -> None:
    """Leave a fault: an empty memory of the law, torque from the last one, a new approach."""
    if state.fault != faults.NONE:
        join(state, state.torque)
        state.fault = faults.NONE


def set_pose(state: Any, pose: Array) -> None:
    """Know the pose, shape (m,), or one near it on the same assembly mode."""
    state.pose, state.lost = pose, False


def same(before: PreparedLaw, after: PreparedLaw) -> bool:
    """Whether a change of law and gains changes nothing."""
    return bool((after.name, after.gains) == (before.name, before.gains))


def switch(state: Any, before: PreparedLaw, after: PreparedLaw) -> None:
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
    if state.initialized and not same(before, after):
        state.excess, state.bumpless = np.zeros(len(state.fault_position)), True


def restart(state: Any, guess: Array) -> None:
    """Before a new run of the plant; a fault, and a pose that is lost, stay so.

    `guess`: its pose, shape (m,).
    """
    begun = cycle.initial_state(guess, len(state.fault_position))
    state.value = begun._replace(fault=state.fault, lost=state.lost)
