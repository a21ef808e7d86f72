"""Identification of the age of the states: its parameters, what refuses it, what it tells."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.estimation.lock_in import (
    APART,
    DELAY,
    END,
    FIRST,
    FOUND,
    KEPT,
    OF_JOINTS,
    OFF,
    ROWS,
    SOUND,
    UNDER_WAY,
    WAITING,
    LockIn,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.compiler import vector
from parallel_robot_model.configuration.fields import Field, PerJoint

LEAST = 4, 20  # samples of an oscillation, oscillations


class LockInParameters(NamedTuple):
    """How ``estimator.delay: identify`` finds the age of the states."""

    torque: Annotated[PerJoint, Field('N m', 'amplitude of the sine that is added', 1e-6)]
    frequency: Annotated[float, Field('Hz', 'its frequency', 0.1)]
    start: Annotated[float, Field('s', 'when it begins, after the first state', 0.0, 1000.0)]
    duration: Annotated[float, Field('s', 'how long it lasts', 0.0, 1000.0)]
    delay: Annotated[float, Field('s', 'age that is assumed until it has ended', 0.0)]


def lock_in_of(
    parameters: LockInParameters, on: bool, period: float, most: float, memory: int = 0
) -> LockIn:
    """Make the lock-in from its parameters; `on`: whether it is to run; see :class:`LockIn`.

    Raises:
        InputError: so few samples or oscillations tell no delay.
    """
    frequency, duration = parameters.frequency, parameters.duration
    samples, oscillations = LEAST
    if on and frequency * period * samples > 1.0:
        fastest = 1.0 / (samples * period)
        raise InputError(
            f'lock_in.frequency must be at most {fastest:g} Hz, {samples} samples of '
            f'{period:g} s to an oscillation, not {frequency:g}',
            'lock_in.frequency',
        )
    if on and duration * frequency < oscillations:
        raise InputError(
            f'lock_in.duration must be at least {oscillations / frequency:g} s, '
            f'{oscillations} oscillations, not {duration:g}',
            'lock_in.duration',
        )
    return LockIn(
        on,
        period,
        vector(parameters.torque),
        2.0 * math.pi * frequency,
        round(parameters.start / period),
        round(duration / period),
        most,
        memory,
    )


class Result(NamedTuple):
    """What has been found.

    Attributes:
        phase: OFF, WAITING (or under way), FOUND or KEPT.
        delay: The delay, found or assumed [s]; 0 before the end.
        of_joints: What each joint tells by itself [s], shape (n,).
        end: The first sample after the end, counted from the first state; 0 before it.
    """

    phase: int
    delay: float
    of_joints: Array
    end: int


def result(lock_in: LockIn) -> Result:
    """What a lock-in has found whose memory is a Space."""
    memory: Any = lock_in.memory
    floats: Array = memory.floats
    rows = floats.reshape(ROWS, -1)
    phase = OFF
    if lock_in.on:
        phase = WAITING if floats[END] == 0.0 else FOUND if rows[SOUND, 0] > 0.0 else KEPT
    end = int(floats[END] - floats[FIRST]) if floats[END] else 0
    return Result(phase, float(rows[DELAY, 0]), rows[OF_JOINTS].copy(), end)


def phases(
    lock_in: LockIn, samples: NDArray[np.int64], first_fault: int | None
) -> NDArray[np.int64]:
    """What a lock-in was doing after samples of a run that it has seen, shape (N,).

    Args:
        lock_in: The lock-in.
        samples: The samples, shape (N,).
        first_fault: The first sample of a fault of the controller, which stays; None without one.
    """
    if not lock_in.on:
        return np.full(len(samples), OFF)
    outcome = result(lock_in)
    under_way = samples >= lock_in.start
    if first_fault is not None:
        under_way &= samples <= first_fault
    doing = np.where(under_way, UNDER_WAY, WAITING)
    return np.where(samples >= outcome.end - 1, outcome.phase, doing) if outcome.end else doing


def text(
    lock_in: LockIn, outcome: Result, assumed: float, phase: int, units: JointUnits = HINGES
) -> str:
    """What it is doing, for people; empty where the delay is not identified.

    Args:
        lock_in: The lock-in.
        outcome: What has been found.
        assumed: The delay without it [s].
        phase: OFF, WAITING, UNDER_WAY, FOUND or KEPT.
        units: Units of the joints.
    """
    low, high = 1e3 * outcome.of_joints.min(), 1e3 * outcome.of_joints.max()
    tell = f'by joint {low:.3f} to {high:.3f} ms'
    known = f'{1e3 * assumed:g} ms assumed'
    if phase == UNDER_WAY:
        size = ', '.join(f'{each:g}' for each in np.unique(lock_in.torque))
        what = (
            f'{size} {units.of("N m")} at {lock_in.frequency / 2.0 / math.pi:g} Hz are added for'
        )
        return f'{known}, being identified: {what} {lock_in.length * lock_in.period:g} s'
    if phase == FOUND:
        cycle = 2e3 * math.pi / lock_in.frequency
        same = f'{cycle:.4g} ms more would look the same'
        return f'{1e3 * outcome.delay:.4g} ms identified, {tell}; {same}'
    if phase == KEPT:
        most = 1e3 * APART * lock_in.period
        return f'{known}, not identified: {tell}, more than {most:g} ms from all, or below 0'
    return f'{known}, not identified yet' if phase == WAITING else ''
