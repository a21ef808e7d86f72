"""A Lissajous curve from rest to rest: an example of a custom trajectory."""

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot.trajectory import Field, PoseMotion, kernel, quintic


class Parameters(NamedTuple):
    center: Annotated[tuple[float, ...], Field('', 'pose')] = (0.49, 0.37, 0.5 * np.pi)
    size: Annotated[tuple[float, ...], Field('', 'amplitudes')] = (0.03, 0.02, 0.1)
    turns: Annotated[tuple[float, ...], Field('', 'periods of each')] = (2.0, 3.0, 1.0)
    duration: Annotated[float, Field('s', 'time from rest to rest', 1e-3)] = 12.0


@kernel
def motion(parameters, t):
    s, s_dot, s_ddot = quintic(parameters.duration, t)
    a, w = np.array(parameters.size), 2.0 * np.pi * np.array(parameters.turns)
    sine, cosine = np.sin(w * s), np.cos(w * s)
    acceleration = a * w * (cosine * s_ddot - w * sine * s_dot**2)
    return PoseMotion(np.array(parameters.center) + a * sine, a * w * cosine * s_dot, acceleration)


def span(parameters):
    return parameters.duration
