"""Zero angles of the encoders that are known, which are taken off the measured positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.configuration.groups import group

ESTIMATOR = 'estimator'  # prefix of their group
ZeroAngle = Annotated[
    PerJoint,
    Field('rad', 'zero angle that is taken off the measured positions, as `calibrate` finds it'),
]


class ZeroAngles(NamedTuple):
    """The part of the estimator's parameters that every node needs that looks at positions."""

    zero_angle: ZeroAngle


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
    """Zero angles that are known [rad], shape (n,).

    Raises:
        InputError: ``estimator.zero_angle`` is wrong.
    """
    return np.array(group(values, ZeroAngles, ESTIMATOR).zero_angle)
