"""Circle at constant speed and constant platform angle (the paper's case 1)."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion


class Parameters(NamedTuple):
    """x = cx + r cos(w t), y = cy + r sin(w t), phi constant."""

    center: Annotated[tuple[float, float], Field('m', 'centre of the circle')]
    radius: Annotated[float, Field('m', 'radius of the circle', 0.0)]
    rate: Annotated[float, Field('rad/s', 'angular rate along the circle, signed')]
    phi: Annotated[float, Field('rad', 'platform angle')]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s].

    Source:
        Doan, Le, Vo (2019), section 4, case 1.
    """
    w = parameters.rate
    cosine = parameters.radius * math.cos(w * t)
    sine = parameters.radius * math.sin(w * t)
    return PoseMotion(
        np.array([parameters.center[0] + cosine, parameters.center[1] + sine, parameters.phi]),
        np.array([-w * sine, w * cosine, 0.0]),
        np.array([-w * w * cosine, -w * w * sine, 0.0]),
    )


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]: one turn."""
    return 2.0 * math.pi / abs(parameters.rate) if parameters.rate else 0.0
