"""Finite Fourier series from rest to rest, which excites the dynamics for their identification."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import with_arrays
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import quintic


class Parameters(NamedTuple):
    """X_i = center_i + A w sum_k (sine_ik sin(k w0 t) + cosine_ik cos(k w0 t)).

    w0 = 2 pi / period, A is the amplitude and w(t) a window: it rises from 0 to 1 in `blend` and
    falls in the last `blend` of the duration, quintic both times. Before and after, the robot
    rests at the centre. The coefficients are those of k = 1 ... K of the first coordinate, then of
    the second, and so on.
    """

    center: Annotated[tuple[float, ...], Field('', 'pose at rest, in the units of the robot')]
    sine: Annotated[tuple[float, ...], Field('', 'coefficients of the sines, by coordinate')]
    cosine: Annotated[tuple[float, ...], Field('', 'coefficients of the cosines, likewise')]
    amplitude: Annotated[float, Field('', 'factor of all coefficients', 0.0)]
    period: Annotated[float, Field('s', 'period of the first harmonic', 1e-3)]
    duration: Annotated[float, Field('s', 'time from rest to rest', 1e-3)]
    blend: Annotated[float, Field('s', 'time of the rise and of the fall of the window', 1e-3)]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s].

    Source:
        Swevers, Ganseman, Tukel, De Schutter, Van Brussel (1997), Optimal robot excitation and
        identification, IEEE Trans. Robotics and Automation 13(5); the window is ours.
    """
    p = parameters
    center, sine, cosine = p.center, p.sine, p.cosine
    m = len(center)
    harmonics = len(sine) // m
    # 1. The window w = rise - fall with two derivatives.
    rise, rise_dot, rise_ddot = quintic(p.blend, t)
    fall, fall_dot, fall_ddot = quintic(p.blend, t - (p.duration - p.blend))
    w = p.amplitude * (rise - fall)
    w_dot = p.amplitude * (rise_dot - fall_dot)
    w_ddot = p.amplitude * (rise_ddot - fall_ddot)
    # 2. The series f of each coordinate, then X = center + w f.
    pose = np.empty(m)
    rate = np.empty(m)
    acceleration = np.empty(m)
    for i in range(m):
        f = 0.0
        f_dot = 0.0
        f_ddot = 0.0
        for k in range(harmonics):
            frequency = 2.0 * math.pi * (k + 1) / p.period
            c, s = math.cos(frequency * t), math.sin(frequency * t)
            a, b = sine[i * harmonics + k], cosine[i * harmonics + k]
            f += a * s + b * c
            f_dot += frequency * (a * c - b * s)
            f_ddot -= frequency**2 * (a * s + b * c)
        pose[i] = center[i] + w * f
        rate[i] = w_dot * f + w * f_dot
        acceleration[i] = w_ddot * f + 2.0 * w_dot * f_dot + w * f_ddot
    return PoseMotion(pose, rate, acceleration)


def validate(parameters: Parameters) -> Parameters:
    """Return the parameters if they describe a motion from rest to rest.

    Raises:
        InputError: there is no centre; the numbers of coefficients are not equal, or not a
            multiple of the coordinates; rise and fall take longer than the duration.
    """
    m, sines, cosines = map(len, (parameters.center, parameters.sine, parameters.cosine))
    if not m:
        raise InputError('excitation.center must hold at least one number', 'excitation.center')
    if not sines or sines != cosines or sines % m:
        raise InputError(
            f'excitation.sine and excitation.cosine must hold K numbers for each of the {m} '
            f'coordinates, not {sines} and {cosines}',
            'excitation',
        )
    if 2.0 * parameters.blend > parameters.duration:
        raise InputError(
            f'excitation.blend must be at most half of excitation.duration = '
            f'{parameters.duration:g} s, not {parameters.blend:g}',
            'excitation.blend',
        )
    return parameters


prepare = with_arrays  # of which `motion` takes the lists


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]."""
    return parameters.duration
