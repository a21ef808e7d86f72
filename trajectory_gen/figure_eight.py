"""Figure of eight (lemniscate of Gerono), all else of the pose constant."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import Plane, drawn, plane_of


class Parameters(NamedTuple):
    """center + length / 2 cos(w t) u + width / 2 sin(2 w t) v, axes u, v turned by the angle."""

    center: Annotated[
        tuple[float, ...], Field('m', 'where it crosses itself: x, y, or a pose in space')
    ]
    length: Annotated[float, Field('m', 'extent along the first axis', 0.0)]
    width: Annotated[float, Field('m', 'extent across it', 0.0)]
    angle: Annotated[float, Field('rad', 'direction of the first axis, from x')]
    rate: Annotated[float, Field('rad/s', 'rate w of one figure, signed')]
    phi: Annotated[float, Field('rad', 'platform angle, with a centre x, y')]
    normal: Annotated[
        tuple[float, float, float], Field('', 'normal of its plane, with a centre in space')
    ]


class FigureEight(NamedTuple):
    """A figure of eight in its plane; length and width [m], rate [rad/s]."""

    plane: Plane
    length: float
    width: float
    rate: float


def prepare(parameters: Parameters) -> FigureEight:
    """The figure of the parameters.

    Raises:
        InputError: the centre is no pose, or the normal is zero.
    """
    center, length, width, angle, rate, phi, normal = parameters
    plane = plane_of('figure_eight.center', center, phi, normal, angle)
    return FigureEight(plane, length, width, rate)


@kernel
def motion(figure: FigureEight, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]; it begins at an end of the figure."""
    w = figure.rate
    half = 0.5 * figure.length
    u, u_dot = half * math.cos(w * t), -half * w * math.sin(w * t)
    half = 0.5 * figure.width
    v, v_dot = half * math.sin(2.0 * w * t), 2.0 * half * w * math.cos(2.0 * w * t)
    return drawn(figure.plane, (u, v), (u_dot, v_dot), (-w * w * u, -4.0 * w * w * v))


def span(figure: FigureEight) -> float:
    """Time after which nothing new happens [s]: one figure."""
    return 2.0 * math.pi / abs(figure.rate) if figure.rate else 0.0
