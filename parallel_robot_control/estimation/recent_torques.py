"""The torques of the last samples: as commanded, and as the motors applied them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Struct, internal, read_row, select, write_row

SIZE = 128  # torques that are remembered
MOST = 50  # samples, largest age from which is predicted


class RecentTorques(NamedTuple):
    """What is remembered, as a Struct; torques in [N m]."""

    newest: int  # index of the last sample of which a torque is remembered
    tracked: bool  # whether the Kalman filter ran at it
    age: float  # from the measurement of the last state to the moment at which its torque acts [s]
    commanded: Array  # torque commanded at a sample, in row sample % SIZE, shape (SIZE, n)
    applied: Array  # what the motors made of the law's over its period, shape (SIZE, n)
    lagged: Array  # the same after the newest of them, shape (n,)
    added: Array  # what was added to the newest torque of the law, see repetition.py, shape (n,)


def recent_torques(zero: Array) -> Struct:
    """No torque yet; `zero`: a vector, shape (n,)."""
    rows = SIZE, len(zero)
    return Struct(RecentTorques(0, False, 0.0, np.zeros(rows), np.zeros(rows), zero, zero))


@internal
def samples_of(setup: Any, time: float) -> int:
    """A time [s] in periods of a ControlSetup."""
    return int(np.rint(time / setup.period))


@internal
def torque_at(torques: Any, sample: int) -> Array:
    """Torque commanded at one of the last SIZE samples [N m], shape (n,)."""
    return read_row(torques.commanded, sample % SIZE, torques.lagged)


@internal
def applied_torque(torques: Any, sample: int) -> Array:
    """What the motors made of the law's torque over the period of a sample [N m], shape (n,)."""
    return read_row(torques.applied, sample % SIZE, torques.lagged)


@internal
def applied_torque_after(torques: Any) -> Array:
    """Mean torque of motors with a lag over that time after the newest period [N m], shape (n,).

    The newest command is held.
    """
    commanded = _newest_of_law(torques)
    return commanded + (torques.lagged - commanded) * (1.0 - math.exp(-1.0))


@internal
def fill(torques: Any, torque: Array) -> None:
    """Take a torque for the one that has acted for long [N m], shape (n,)."""
    for k in range(SIZE):
        write_row(torques.commanded, k, torque)
        write_row(torques.applied, k, torque)
    torques.lagged, torques.added = torque, np.zeros_like(torque)


@internal
def _newest_of_law(torques: Any) -> Array:
    """The newest torque without what was added to that of the law [N m], shape (n,)."""
    return torque_at(torques, torques.newest) - torques.added


@internal
def record(setup: Any, sample: int, torque: Array, added: Array, tracking: bool) -> None:
    """Keep the torque that acts from a sample on; where samples are left out, the last one acted.

    Args:
        setup: The ControlSetup.
        sample: Index of the sample.
        torque: [N m], shape (n,).
        added: What of it was added to that of the law [N m], shape (n,).
        tracking: Whether the filter ran at this sample.
    """
    torques, lag, period = setup.memory.torques, setup.estimator.lag, setup.period
    last = torques.newest
    if sample > last + 1:
        held, of_law = torque_at(torques, last), _newest_of_law(torques)
        for missed in range(max(last + 1, sample - SIZE), sample):
            write_row(torques.commanded, missed % SIZE, held)
            _record_applied(torques, missed, of_law, lag, period)
    write_row(torques.commanded, sample % SIZE, torque)
    torques.added = added
    _record_applied(torques, sample, torque - added, lag, period)
    torques.newest, torques.tracked = sample, tracking


@internal
def _record_applied(torques: Any, sample: int, torque: Array, lag: float, period: float) -> None:
    """Keep what motors with a lag of first order make of a torque: its mean, and the last."""
    mean = torque
    if lag > 0.0:
        before, left = torques.lagged, math.exp(-period / lag)
        mean = torque + (before - torque) * ((1.0 - left) * lag / period)
        torques.lagged = torque + (before - torque) * left
    write_row(torques.applied, sample % SIZE, mean)


@internal
def between(torques: Any, age: float, initialized: bool, dt: float) -> float:
    """Time between the moments at which the last torque and the next one act [s].

    Args:
        torques: What is remembered.
        age: From the measurement of a state to the moment at which its torque acts [s].
        initialized: Whether there was a state before.
        dt: Time between the measurements [s].
    """
    before, torques.age = torques.age, age
    return select(
        initialized and age != before, dt + age - before, dt
    )  # exact where they are equal
