"""Measured positions less the zero angles that the controller knows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_control.estimator import EstimatorParameters
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.configuration.groups import group


def corrected(values: Mapping[str, Any], position: Array) -> Array:
    """Positions of the joints as the controller takes them.

    Args:
        values: A resolved configuration, perhaps that of a bag.
        position: Measured positions [rad], shape (N, n).

    Raises:
        InputError: ``estimator.zero_angle`` is wrong.
    """
    return np.asarray(position - known(values), np.float64)


def known(values: Mapping[str, Any]) -> Array:
    """Zero angles that the controller knows [rad], shape (n,).

    Raises:
        InputError: ``estimator.zero_angle`` is wrong.
    """
    return np.array(group(values, EstimatorParameters, 'estimator').zero_angle)
