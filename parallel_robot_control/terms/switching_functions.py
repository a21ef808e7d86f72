"""Functions for switching and terminal terms: sig(x) and sat(x)."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, kernel


@kernel
def sig(x: Array, exponent: float) -> Array:
    """|x|^exponent sgn(x), element-wise, shape (n,)."""
    return np.copysign(np.abs(x) ** exponent, x)


@kernel
def saturate(x: Array) -> Array:
    """Each element of `x` clipped to -1 ... 1, shape (n,)."""
    return clip(x, -1.0, 1.0)
