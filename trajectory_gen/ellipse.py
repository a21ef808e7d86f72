"""Ellipse, run through at a constant rate of its parameter, with constant platform angle."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.plane import turned


class Parameters(NamedTuple):
    """(x, y) = center + R(angle) (a cos(w t), b sin(w t)), phi constant."""

    center: Annotated[tuple[float, float], Field('m', 'centre of the ellipse')]
    semi_axes: Annotated[tuple[float, float], Field('m', 'a and b, half the diameters', 0.0)]
    angle: Annotated[float, Field('rad', 'direction of the first axis, from x')]
    rate: Annotated[float, Field('rad/s', 'rate w along the ellipse, signed')]
    phi: Annotated[float, Field('rad', 'platform angle')]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    w = parameters.rate
    u = parameters.semi_axes[0] * math.cos(w * t)
    v = parameters.semi_axes[1] * math.sin(w * t)
    u_dot = -parameters.semi_axes[0] * w * math.sin(w * t)
    v_dot = parameters.semi_axes[1] * w * math.cos(w * t)
    center, angle, phi = parameters.center, parameters.angle, parameters.phi
    return turned(center, angle, phi, (u, v), (u_dot, v_dot), (-w * w * u, -w * w * v))


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]: one turn."""
    return 2.0 * math.pi / abs(parameters.rate) if parameters.rate else 0.0
