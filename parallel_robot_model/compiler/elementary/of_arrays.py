"""Elementary functions for Python: of a number, or of an array element by element."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.compiler.elementary import names  # noqa: F401 what np.sin is here
from parallel_robot_model.compiler.kernels import kernel


@kernel
def sine(x: Any) -> Any:
    """Sine of angles [rad]; as all here, the same bits on every processor."""
    return np.sin(x)


@kernel
def cosine(x: Any) -> Any:
    """Cosine of angles [rad]."""
    return np.cos(x)


@kernel
def arctangent(y: Any, x: Any) -> Any:
    """Angles of the directions (x, y) [rad]."""
    return np.arctan2(y, x)
