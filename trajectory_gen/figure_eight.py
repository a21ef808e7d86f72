"""Figure of eight (lemniscate of Gerono) with constant platform angle."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.plane import turned


class Parameters(NamedTuple):
    """(x, y) = center + R(angle) (length / 2 cos(w t), width / 2 sin(2 w t)), phi constant."""

    center: Annotated[tuple[float, float], Field('m', 'where the figure crosses itself')]
    length: Annotated[float, Field('m', 'extent along the first axis', 0.0)]
    width: Annotated[float, Field('m', 'extent across it', 0.0)]
    angle: Annotated[float, Field('rad', 'direction of the first axis, from x')]
    rate: Annotated[float, Field('rad/s', 'rate w of one figure, signed')]
    phi: Annotated[float, Field('rad', 'platform angle')]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]; it begins at an end of the figure."""
    w = parameters.rate
    half = 0.5 * parameters.length
    u, u_dot = half * math.cos(w * t), -half * w * math.sin(w * t)
    half = 0.5 * parameters.width
    v, v_dot = half * math.sin(2.0 * w * t), 2.0 * half * w * math.cos(2.0 * w * t)
    center, angle, phi = parameters.center, parameters.angle, parameters.phi
    return turned(center, angle, phi, (u, v), (u_dot, v_dot), (-w * w * u, -4.0 * w * w * v))


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]: one figure."""
    return 2.0 * math.pi / abs(parameters.rate) if parameters.rate else 0.0
