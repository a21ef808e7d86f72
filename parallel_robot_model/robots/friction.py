"""Viscous and Coulomb friction of the actuated joints."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.compiler import clip, kernel, select, vector
from parallel_robot_model.configuration.fields import Field, PerJoint


class FrictionParameters(NamedTuple):
    """fr_i = viscous_i thd_i + coulomb_i sgn(thd_i).

    Source:
        Doan, Le, Vo (2019), section 4, with thd_2 for the misprinted thd_1 of the second joint.
    """

    viscous: Annotated[PerJoint, Field('N m s/rad', 'viscous friction per joint', 0.0)]
    coulomb: Annotated[PerJoint, Field('N m', 'dry friction per joint', 0.0)]
    smoothing: Annotated[float, Field('rad/s', 'half width of a linear sgn; 0: exact', 0.0)]


@kernel
def friction_torque(friction: FrictionParameters, velocity: Array) -> Array:
    """Torque against the motion [N m], shape (n,); `velocity` [rad/s], shape (n,)."""
    smooth = clip(velocity / friction.smoothing, -1.0, 1.0)
    sign = select(friction.smoothing > 0.0, smooth, np.sign(velocity))
    return vector(friction.viscous) * velocity + vector(friction.coulomb) * sign
