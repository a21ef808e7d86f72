"""A motion in a plane, drawn about a centre along axes that are turned by an angle."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.compiler import kernel
from parallel_robot_model.robots.contract import PoseMotion

Vector = tuple[float, float]


@kernel
def turned(
    center: Vector, angle: float, phi: float, place: Vector, rate: Vector, acceleration: Vector
) -> PoseMotion:
    """Motion of the platform from that along the turned axes; phi constant.

    Args:
        center: Origin of the axes [m].
        angle: Direction of the first axis [rad].
        phi: Platform angle [rad].
        place: Along the first and the second axis [m].
        rate: Its first derivative.
        acceleration: Its second derivative.
    """
    c, s = math.cos(angle), math.sin(angle)
    return PoseMotion(
        np.array(
            [
                center[0] + c * place[0] - s * place[1],
                center[1] + s * place[0] + c * place[1],
                phi,
            ]
        ),
        np.array([c * rate[0] - s * rate[1], s * rate[0] + c * rate[1], 0.0]),
        np.array(
            [
                c * acceleration[0] - s * acceleration[1],
                s * acceleration[0] + c * acceleration[1],
                0.0,
            ]
        ),
    )
