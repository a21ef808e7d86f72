"""Memory of a control cycle, by its address: commands, filter, checks, lock-in, repetition.

What the compiled cycle keeps besides its state lies here, so that little is handed over at a call.
"""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_control.estimation import lock_in
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Space, inner, read_at, select, write_at

SIZE = 128  # torques that are remembered
# Floats in the first rows: newest sample; whether the filter ran at it; how long torque has been
# missing [s]; whether it is, see checks.py; age of the last state [s].
SAMPLE, RUNNING, SPELL, LOST, AGE = range(5)
MEAN, VARIANCE, TORQUE = 5, 10, 25  # rows where those of the filter, and the torques, begin
ACTING = TORQUE + SIZE  # row where what motors make of the torques of the law begins
LAGGED = ACTING + SIZE  # row of that torque after the newest of them
ADDED = LAGGED + 1  # and of what was added to the newest torque of the law, see repetition.py
WAYS = ADDED + 1  # row where those of checks.py begin
OF_WAYS = 6
MOMENTUM = WAYS + OF_WAYS  # and those of checks.py
APPROACH = MOMENTUM + 5  # of approach.py
LEVELS = APPROACH + 6  # and of kalman.py
ROWS = LEVELS + 3


def made_for(like: Array, more: int = 0) -> Space:
    """Memory of filter, checks and lock-in for vectors as `like`, shape (n,); `more`: rows."""
    return Space((ROWS + lock_in.ROWS + more) * like.size)


def of_lock_in(memory: Space, joints: int) -> Space:
    """The part of the memory that is the lock-in's."""
    return Space.within(memory.floats[ROWS * joints : (ROWS + lock_in.ROWS) * joints])


def of_repetition(memory: Space, joints: int) -> Space:
    """The part of the memory behind it, which is that of repetition.py."""
    return Space.within(memory.floats[(ROWS + lock_in.ROWS) * joints :])


@inner
def newest(memory: int) -> int:
    """Index of the last sample of which a torque is remembered."""
    return int(read_at(memory, SAMPLE, 0.0))


@inner
def torque_at(memory: int, sample: int, like: Array) -> Array:
    """Torque that was asked for at one of the last SIZE samples [N m], shape (n,), as `like`."""
    return read_at(memory, TORQUE + sample % SIZE, like)


@inner
def acting_at(memory: int, sample: int, like: Array) -> Array:
    """What the motors made of the law's torque over the period of a sample [N m], shape (n,)."""
    return read_at(memory, ACTING + sample % SIZE, like)


@inner
def acting_after(memory: int, like: Array) -> Array:
    """Mean torque of motors with a lag over that time after the newest period [N m], shape (n,).

    The newest command is held.
    """
    asked = _newest_of_law(memory, like)
    return asked + (read_at(memory, LAGGED, like) - asked) * (1.0 - math.exp(-1.0))


@inner
def fill(memory: int, torque: Array) -> None:
    """Take a torque for the one that has acted for long [N m], shape (n,)."""
    for k in range(SIZE):
        write_at(memory, TORQUE + k, torque)
        write_at(memory, ACTING + k, torque)
    write_at(memory, LAGGED, torque)
    write_at(memory, ADDED, np.zeros_like(torque))


@inner
def _newest_of_law(memory: int, like: Array) -> Array:
    """The newest torque without what was added to that of the law [N m], shape (n,)."""
    return torque_at(memory, newest(memory), like) - read_at(memory, ADDED, like)


@inner
def remember(
    memory: int,
    sample: int,
    torque: Array,
    added: Array,
    tracking: bool,
    lag: float,
    period: float,
) -> None:
    """Keep the torque that acts from a sample on; where samples are left out, the last one acted.

    Args:
        memory: The memory.
        sample: Index of the sample.
        torque: [N m], shape (n,).
        added: What of it was added to that of the law [N m], shape (n,).
        tracking: Whether the filter ran at this sample.
        lag: Time constant of the motors [s].
        period: Of the samples [s].
    """
    last = newest(memory)
    if sample > last + 1:
        held, of_law = torque_at(memory, last, torque), _newest_of_law(memory, torque)
        for missed in range(max(last + 1, sample - SIZE), sample):
            write_at(memory, TORQUE + missed % SIZE, held)
            _act(memory, missed, of_law, lag, period)
    write_at(memory, TORQUE + sample % SIZE, torque)
    write_at(memory, ADDED, added)
    _act(memory, sample, torque - added, lag, period)
    write_at(memory, SAMPLE, float(sample))
    write_at(memory, RUNNING, 1.0 if tracking else 0.0)


@inner
def _act(memory: int, sample: int, torque: Array, lag: float, period: float) -> None:
    """Keep what motors with a lag of first order make of a torque: its mean, and the last."""
    write_at(memory, ACTING + sample % SIZE, torque)
    if lag > 0.0:
        before, left = read_at(memory, LAGGED, torque), math.exp(-period / lag)
        mean = torque + (before - torque) * ((1.0 - left) * lag / period)
        write_at(memory, ACTING + sample % SIZE, mean)
        write_at(memory, LAGGED, torque + (before - torque) * left)


@inner
def between(memory: int, age: float, known: bool, dt: float) -> float:
    """Time between the moments at which the last torque and the next one act [s].

    Args:
        memory: The memory.
        age: From the measurement of a state to the moment at which its torque acts [s].
        known: Whether there was a state before.
        dt: Time between the measurements [s].
    """
    before = read_at(memory, AGE, 0.0)
    write_at(memory, AGE, age)
    return select(known and age != before, dt + age - before, dt)  # exact where they are equal
