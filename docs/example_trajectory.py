"""A Lissajous curve that begins and ends at rest: an example of a custom trajectory."""

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_base.fields import Field
from parallel_robot_compiler import kernel
from parallel_robot_model.contract import PoseMotion
from trajectory_gen.time_law import quintic


class Parameters(NamedTuple):
    center: Annotated[tuple[float, ...], Field('', 'pose around which it moves')] = (
        0.5,
        0.35,
        0.4,
    )
    size: Annotated[tuple[float, ...], Field('', 'amplitude of each coordinate')] = (
        0.03,
        0.02,
        0.1,
    )
    turns: Annotated[tuple[float, ...], Field('', 'periods of each')] = (2.0, 3.0, 1.0)
    duration: Annotated[float, Field('s', 'time from rest to rest', 1e-3)] = 6.0


@kernel
def motion(parameters, t):
    s, s_dot, s_ddot = quintic(parameters.duration, t)
    w = 2.0 * math.pi * np.array(parameters.turns)
    a = np.array(parameters.size)
    pose = np.array(parameters.center) + a * np.sin(w * s)
    rate = a * w * np.cos(w * s) * s_dot
    acceleration = a * w * (np.cos(w * s) * s_ddot - w * np.sin(w * s) * s_dot**2)
    return PoseMotion(pose, rate, acceleration)


def span(parameters):
    return parameters.duration
