"""The reference of each state: the newest one, how old it is, and what is said without one."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.reference_buffer import extrapolate_rows
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import topics

NO_REFERENCE = 'have no reference of their time'


def newest_age(stamps: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Age of the newest reference at each state [ns], shape (N,); negative before the first.

    Args:
        stamps: Of the states [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
    """
    age: np.ndarray = stamps - known[_newest(stamps, known)]
    return age


def _newest(stamps: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Number of the newest of some stamps at others, shape (N,); the first before it."""
    return np.maximum(np.searchsorted(known, stamps, side='right') - 1, 0)


def reference_at(
    stamps: np.ndarray,
    known: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> JointReference:
    """Extrapolate references to other stamps, each from the newest before with its derivatives.

    Args:
        stamps: Where they are wanted; before the first known one, it counts [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
        position: Joint angles [rad], shape (M, n).
        velocity: Their rates [rad/s], shape (M, n).
        acceleration: Their accelerations [rad/s^2], shape (M, n).
    """
    newest = _newest(stamps, known)
    return extrapolate_rows(
        stamps - known[newest], position[newest], velocity[newest], acceleration[newest]
    )


def timeout(values: dict[str, Any], stamps: np.ndarray) -> int:
    """Age at which a reference ends [ns]: that of the controller, at least two periods of it."""
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    return round(max(values['safety.reference_timeout'] * NANOSECONDS, 2.0 * period))


def without_reference(
    stamps: np.ndarray, start: int, known: np.ndarray, referenced: np.ndarray
) -> str:
    """What to know of states without a reference of their time."""
    count, first = int((~referenced).sum()), int(np.argmin(referenced))
    time = (stamps[first] - start) / NANOSECONDS
    if referenced.any():
        return unreferenced(count, time)
    behind = float(np.median(stamps) - np.median(known)) / NANOSECONDS
    return (
        'no state has a reference of its time: the stamps of '
        f'{topics.REFERENCE.name} are {behind:.3g} s behind those of {topics.JOINT_STATES.name}: '
        'of another clock'
    )


def unreferenced(count: int, time: float) -> str:
    """That so many states, from a time on [s], have no reference, in words."""
    what = f'{count} states, from t = {time:.3f} s on, {NO_REFERENCE}'
    return f'{what}: they have no error and are left out'
