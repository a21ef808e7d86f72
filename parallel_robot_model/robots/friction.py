"""Viscous friction, dry friction and the Stribeck effect of the actuated joints."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, kernel, select, some, vector
from parallel_robot_model.configuration.fields import Field, PerJoint


class FrictionParameters(NamedTuple):
    """fr = viscous thd + (coulomb + stribeck exp(-(thd / stribeck_velocity)^2)) sgn(thd).

    Source:
        Doan, Le, Vo (2019), section 4, with thd_2 for the misprinted thd_1 of the second joint;
        Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), eq. (2.3), for the
        Stribeck effect.
    """

    viscous: Annotated[PerJoint, Field('N m s/rad', 'viscous friction per joint', 0.0)]
    coulomb: Annotated[PerJoint, Field('N m', 'dry friction per joint', 0.0)]
    stribeck: Annotated[PerJoint, Field('N m', 'more dry friction at rest, per joint', 0.0)]
    stribeck_velocity: Annotated[float, Field('rad/s', 'at which a third of it is left', 1e-6)]
    smoothing: Annotated[float, Field('rad/s', 'half width of a linear sgn; 0: exact', 0.0)]


@kernel
def friction_torque(friction: FrictionParameters, velocity: Array) -> Array:
    """Torque against the motion [N m], shape (n,); `velocity` [rad/s], shape (n,)."""
    smooth = clip(velocity / friction.smoothing, -1.0, 1.0)
    sign = select(friction.smoothing > 0.0, smooth, np.sign(velocity))
    dry, more = vector(friction.coulomb), vector(friction.stribeck)
    if some(more != 0.0):
        share = velocity / friction.stribeck_velocity
        dry = dry + more * np.exp(-share * share)
    return vector(friction.viscous) * velocity + dry * sign
