"""Random numbers by counter: each follows from seed, sample and stream, so there is no state.

The nodes and a simulation draw the same numbers, in whatever order they ask.
"""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel, read_at, write_at

MAX_SEED = 2**53  # kernels take the seed as a float

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_BELOW_ONE = 2.0**-53
_PLACES = 1 << 20  # numbers of one stream at one sample


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


@inner
def normals(seed: float, sample: int, stream: int, draws: int, like: Array) -> Array:
    """Standard normal numbers, one an element, of the type of `like`.

    Args:
        seed: Seed of the run.
        sample: Index of the sample.
        stream: What the numbers are for.
        draws: Address of space for as many numbers as `like` has, which is overwritten.
        like: Any vector, shape (n,).
    """
    for i in range(len(like)):
        write_at(draws, i, normal(seed, sample, stream * _PLACES + i))
    return read_at(draws, 0, like)


@inner
def whole_number(seed: float, sample: int, stream: int, largest: float) -> float:
    """A whole number from 0 to `largest`, each equally likely, as a float."""
    return np.floor(uniform(seed, sample, stream * _PLACES) * (largest + 1.0))
