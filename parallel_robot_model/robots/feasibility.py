"""Which sample of a motion a robot cannot perform."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import apart
from parallel_robot_model.common.units import Array


class Infeasible(NamedTuple):
    """The first sample of a motion that the robot cannot perform.

    Attributes:
        sample: Index of the sample.
        part: Number of the leg or joint that fails, 1-based; None if it is the whole robot.
        reason: The reason, for people.
    """

    sample: int
    part: int | None
    reason: str


def first_sample(
    bad: NDArray[np.bool_], values: Array, text: str, limit: float | None = None
) -> Infeasible | None:
    """The first sample that is bad; None if all are good.

    Args:
        bad: Which samples are bad, shape (N,), or (N, n) with a column for each leg or joint.
        values: Values for the text, same shape.
        text: The reason, with a placeholder for the value, and one for the limit if there is one.
        limit: What the value is compared with; both get digits enough to differ.
    """
    if not bad.any():
        return None
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    part = index[1] + 1 if len(index) == 2 else None
    value = float(values[index])
    shown = (value,) if limit is None else apart(value, limit)
    return Infeasible(index[0], part, text.format(*shown))
