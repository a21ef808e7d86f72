"""What imperfect devices add: random numbers by counter, and delays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, kernel, read_row, select, write_row

# Random numbers by counter: each follows from seed, sample and stream, so there is no state.
#
# The nodes and a simulation draw the same numbers, in whatever order they ask.

MAX_SEED = 2**53  # kernels take the seed as a float

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_BELOW_ONE = 2.0**-53
_DRAWS = 1 << 20  # numbers of one stream at one sample


@kernel
def mixed(z: np.uint64) -> np.uint64:
    """One output of SplitMix64 for the state `z`, unsigned 64 bits.

    Source:
        Steele, Lea, Flood (2014), Fast splittable pseudorandom number generators.
    """
    z = z + _GOLDEN
    z = (z ^ (z >> _30)) * _FIRST
    z = (z ^ (z >> _27)) * _SECOND
    return z ^ (z >> _31)


@kernel
def uniform(seed: float, sample: int, place: int) -> float:
    """A number from [0, 1)."""
    z = mixed(mixed(mixed(np.uint64(seed)) ^ np.uint64(sample)) ^ np.uint64(place))
    return float(z >> _11) * _BELOW_ONE


@kernel
def normal(seed: float, sample: int, place: int) -> float:
    """A number of the standard normal distribution, by Box and Muller."""
    first, second = uniform(seed, sample, 2 * place), uniform(seed, sample, 2 * place + 1)
    return math.sqrt(-2.0 * math.log(1.0 - first)) * math.cos(2.0 * math.pi * second)


@internal
def normals(seed: float, sample: int, stream: int, draws: Array, template: Array) -> Array:
    """Standard normal numbers, one an element, of the type of `template`.

    Args:
        seed: Seed of the run.
        sample: Index of the sample.
        stream: What the numbers are for.
        draws: Room for as many numbers as `template` has, an array, which is overwritten.
        template: Any vector, shape (n,).
    """
    for i in range(len(template)):
        draws[i] = normal(seed, sample, stream * _DRAWS + i)
    return read_row(draws, 0, template)


@internal
def whole_number(seed: float, sample: int, stream: int, largest: float) -> float:
    """A whole number from 0 to `largest`, each equally likely, as a float."""
    return np.floor(uniform(seed, sample, stream * _DRAWS) * (largest + 1.0))


# What an imperfect plant remembers of its last samples: rows that wrap around.
#
# The index of the sample alone says what is read and written where, so a step that is done again
# leaves the same behind, and a new run needs no clearing.

# Kinds of vectors,
POSITION, VELOCITY, COMMAND, LAGGED, DISTURBANCE, EFFORT, ROTOR, ROTOR_RATE, BRISTLES = range(9)
# and streams of random numbers.
OF_POSITION, OF_VELOCITY, OF_TORQUE, OF_LOAD, OF_STATES, OF_COMMANDS = range(6)


@internal
def sample_at(time: float, period: float) -> int:
    """Index of the sample at a time since the start [s]."""
    return int(time / period + 0.5)


@internal
def recall(setup: Any, kind: int, sample: int, template: Array) -> Array:
    """A vector of one of the last samples, of the type of `template`."""
    size = setup.imperfections.depth + 2
    return read_row(setup.imperfections.memory, kind * size + sample % size, template)


@internal
def record(setup: Any, kind: int, sample: int, value: Array) -> None:
    """Keep a vector of a sample."""
    size = setup.imperfections.depth + 2
    write_row(setup.imperfections.memory, kind * size + sample % size, value)


@internal
def lateness(
    setup: Any, stream: int, sample: int, delay: float, jitter: float, period: float
) -> float:
    """By how many samples the message of a sample comes late."""
    most = np.floor(jitter / period + 0.5)
    drawn = whole_number(setup.imperfections.seed, sample, stream, most)
    return np.floor(delay / period + 0.5) + drawn


@internal
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
