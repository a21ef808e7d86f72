"""Circle at constant speed, all else of the pose constant (the paper's case 1)."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import Plane, drawn, plane_of


class Parameters(NamedTuple):
    """center + r cos(w t) u + r sin(w t) v with the axes u, v of its plane."""

    center: Annotated[tuple[float, ...], Field('m', 'centre: x, y, or a pose in space')]
    radius: Annotated[float, Field('m', 'radius of the circle', 0.0)]
    rate: Annotated[float, Field('rad/s', 'angular rate along the circle, signed')]
    phi: Annotated[float, Field('rad', 'platform angle, with a centre x, y')]
    normal: Annotated[
        tuple[float, float, float], Field('', 'normal of its plane, with a centre in space')
    ]


class Circle(NamedTuple):
    """A circle in its plane; radius [m], rate [rad/s]."""

    plane: Plane
    radius: float
    rate: float


def prepare(parameters: Parameters) -> Circle:
    """The circle of the parameters.

    Raises:
        InputError: the centre is no pose, or the normal is zero.
    """
    center, radius, rate, phi, normal = parameters
    return Circle(plane_of('circle.center', center, phi, normal), radius, rate)


@kernel
def motion(circle: Circle, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s].

    Source:
        Doan, Le, Vo (2019), section 4, case 1.
    """
    w = circle.rate
    cosine = circle.radius * math.cos(w * t)
    sine = circle.radius * math.sin(w * t)
    return drawn(
        circle.plane, (cosine, sine), (-w * sine, w * cosine), (-w * w * cosine, -w * w * sine)
    )


def span(circle: Circle) -> float:
    """Time after which nothing new happens [s]: one turn."""
    return 2.0 * math.pi / abs(circle.rate) if circle.rate else 0.0
