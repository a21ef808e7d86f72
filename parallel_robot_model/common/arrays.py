"""Numerical arrays: their type in annotations, and groups that hold them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # docstrings say shape and unit


def with_arrays(group: Any) -> Any:
    """A NamedTuple whose lists are arrays, so that it has one type for kernels, however long."""
    return group._make(np.array(value) if isinstance(value, tuple) else value for value in group)
