"""For how long the motors of a plant gave all they can."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_model.robots.registry import units_of

SATURATED = 'the motors were at their limit (plant.torque_limit, {0} {2}) in {1} % of the samples'


def saturation(values: Mapping[str, Any], effort: np.ndarray) -> list[str]:
    """A line that says for how long the motors of the plant gave all they can, if they did.

    Args:
        values: The resolved configuration.
        effort: Torques of the motors [N m], shape (N, n).
    """
    return saturation_of(values, int(saturated(values, effort).sum()), len(effort))


def saturated(values: Mapping[str, Any], effort: np.ndarray) -> np.ndarray:
    """At which samples the motors gave all they can, shape (N,); see :func:`saturation`."""
    limit = np.asarray(values['plant.torque_limit'], np.float64)
    if limit.size not in (1, effort.shape[1]):  # of a bag; such a plant cannot be built
        return np.zeros(len(effort), bool)
    reached: np.ndarray = (np.abs(effort) >= limit).any(axis=1)
    return reached


def saturation_of(values: Mapping[str, Any], count: int, of: int) -> list[str]:
    """The line of :func:`saturation`, for so many samples of so many."""
    if not count:
        return []
    limit = np.asarray(values['plant.torque_limit'], np.float64)
    told = ', '.join(f'{each:g}' for each in np.unique(limit))
    return [SATURATED.format(told, f'{100.0 * (count / of):.3g}', units_of(values).of('N m'))]
