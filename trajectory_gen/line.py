"""Straight line from rest to rest with a quintic time law (the paper's case 2)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.time_law import quintic


class Parameters(NamedTuple):
    """From `start` to `end` in `duration`, then at rest; phi constant."""

    start: Annotated[tuple[float, float], Field('m', 'first point')]
    end: Annotated[tuple[float, float], Field('m', 'last point')]
    duration: Annotated[float, Field('s', 'time from the first to the last point', 1e-3)]
    phi: Annotated[float, Field('rad', 'platform angle')]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    s, s_dot, s_ddot = quintic(parameters.duration, t)
    dx = parameters.end[0] - parameters.start[0]
    dy = parameters.end[1] - parameters.start[1]
    return PoseMotion(
        np.array([parameters.start[0] + s * dx, parameters.start[1] + s * dy, parameters.phi]),
        np.array([s_dot * dx, s_dot * dy, 0.0]),
        np.array([s_ddot * dx, s_ddot * dy, 0.0]),
    )


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]."""
    return parameters.duration
