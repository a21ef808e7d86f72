"""Ellipse, run through at a constant rate of its parameter, all else of the pose constant."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import Plane, drawn, plane_of


class Parameters(NamedTuple):
    """center + a cos(w t) u + b sin(w t) v, axes u, v turned by the angle."""

    center: Annotated[tuple[float, ...], Field('m', 'centre: x, y, or a pose in space')]
    semi_axes: Annotated[tuple[float, float], Field('m', 'a and b, half the diameters', 0.0)]
    angle: Annotated[float, Field('rad', 'direction of the first axis, from x')]
    rate: Annotated[float, Field('rad/s', 'rate w along the ellipse, signed')]
    phi: Annotated[float, Field('rad', 'platform angle, with a centre x, y')]
    normal: Annotated[
        tuple[float, float, float], Field('', 'normal of its plane, with a centre in space')
    ]


class Ellipse(NamedTuple):
    """An ellipse in its plane; semi-axes [m], rate [rad/s]."""

    plane: Plane
    semi_axes: tuple[float, float]
    rate: float


def prepare(parameters: Parameters) -> Ellipse:
    """The ellipse of the parameters.

    Raises:
        InputError: the centre is no pose, or the normal is zero.
    """
    center, semi_axes, angle, rate, phi, normal = parameters
    plane = plane_of('ellipse.center', center, phi, normal, angle)
    return Ellipse(plane, semi_axes, rate)


@kernel
def motion(ellipse: Ellipse, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    w = ellipse.rate
    u = ellipse.semi_axes[0] * math.cos(w * t)
    v = ellipse.semi_axes[1] * math.sin(w * t)
    u_dot = -ellipse.semi_axes[0] * w * math.sin(w * t)
    v_dot = ellipse.semi_axes[1] * w * math.cos(w * t)
    return drawn(ellipse.plane, (u, v), (u_dot, v_dot), (-w * w * u, -w * w * v))


def span(ellipse: Ellipse) -> float:
    """Time after which nothing new happens [s]: one turn."""
    return 2.0 * math.pi / abs(ellipse.rate) if ellipse.rate else 0.0
