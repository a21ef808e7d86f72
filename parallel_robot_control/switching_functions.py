"""Functions for switching and terminal terms: sig(x) and sat(x)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel

Array = NDArray[np.float64]


@kernel
def sig(x: Array, exponent: float) -> Array:
    """|x|^exponent sgn(x), element-wise, shape (n,)."""
    result = np.empty(len(x))
    for i in range(len(x)):
        result[i] = math.copysign(abs(x[i]) ** exponent, x[i])
    return result


@kernel
def saturate(x: Array) -> Array:
    """Each element of `x` clipped to -1 ... 1, shape (n,)."""
    result = np.empty(len(x))
    for i in range(len(x)):
        result[i] = min(max(x[i], -1.0), 1.0)
    return result
