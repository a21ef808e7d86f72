"""What an imperfect plant remembers of its last samples: vectors in a space that wraps around.

The index of the sample alone says what is read and written where, so a step that is done again
leaves the same behind, and a new run needs no clearing.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, read_at, select, write_at
from parallel_robot_sim.random_numbers import whole_number

# Kinds of vectors,
POSITION, VELOCITY, COMMAND, LAGGED, DISTURBANCE, EFFORT, ROTOR, ROTOR_RATE, BRISTLES = range(9)
# and streams of random numbers.
OF_POSITION, OF_VELOCITY, OF_TORQUE, OF_LOAD, OF_STATES, OF_COMMANDS = range(6)


@inner
def sample_at(time: float, period: float) -> int:
    """Index of the sample at a time since the start [s]."""
    return int(time / period + 0.5)


@inner
def recall(setup: Any, kind: int, sample: int, like: Array) -> Array:
    """A vector of one of the last samples, of the type of `like`."""
    size = setup.imperfections.depth + 2
    return read_at(setup.imperfections.memory, kind * size + sample % size, like)


@inner
def remember(setup: Any, kind: int, sample: int, value: Array) -> None:
    """Keep a vector of a sample."""
    size = setup.imperfections.depth + 2
    write_at(setup.imperfections.memory, kind * size + sample % size, value)


@inner
def lateness(
    setup: Any, stream: int, sample: int, delay: float, jitter: float, period: float
) -> float:
    """By how many samples the message of a sample comes late."""
    most = np.floor(jitter / period + 0.5)
    drawn = whole_number(setup.imperfections.seed, sample, stream, most)
    return np.floor(delay / period + 0.5) + drawn


@inner
def newest(
    setup: Any,
    kind: int,
    stream: int,
    sample: int,
    now: Array,
    before: Array,
    delay: float,
    jitter: float,
    period: float,
) -> Array:
    """The newest vector that has arrived by a sample.

    Args:
        setup: The plant.
        kind: Which vectors.
        stream: Random numbers of their jitter.
        sample: Index of the present sample.
        now: The vector sent at this sample.
        before: The vector from before the first sample.
        delay: Of all of them [s].
        jitter: Largest further delay [s].
        period: Of the samples [s].
    """
    delayed = before
    for j in range(max(0, sample - setup.imperfections.depth), sample):
        here = lateness(setup, stream, j, delay, jitter, period) <= float(sample - j)
        delayed = select(here, recall(setup, kind, j, now), delayed)
    here = lateness(setup, stream, sample, delay, jitter, period) <= 0.0
    return select(here, now, delayed)
