"""Rounding to significant digits."""

from __future__ import annotations

from typing import Any

import numpy as np


def rounded(value: Any, digits: int) -> Any:
    """Round a number, or each of a nested list, tuple or array of them.

    Args:
        value: The number, or the numbers.
        digits: Significant digits that are kept.

    Returns:
        A float, or lists of them.
    """
    if isinstance(value, (list, tuple)) or np.ndim(value):
        return [rounded(item, digits) for item in value]
    return float(f'{float(value):.{digits}g}')
