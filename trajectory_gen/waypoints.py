"""Spline through or near given poses at given times, of any robot."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.configuration.points import MAX_POINTS
from parallel_robot_model.robots.contract import PoseMotion

RESIDUAL = 1e-9  # of a spline at its points, relative to the largest coordinate


class Parameters(NamedTuple):
    """From the first point to the last, from rest to rest, or periodic; then at rest.

    The spline is the motion of least mean square jerk through the points, or of that and the mean
    square distance from them, with weight ``smoothing``.
    """

    times: Annotated[tuple[float, ...], Field('s', 'time of each point')]
    points: Annotated[tuple[float, ...], Field('', 'one after another, in the units of the robot')]
    file: Annotated[str, Field('', 'CSV to read times and points from, instead')]
    columns: Annotated[
        tuple[str, ...],
        Field(
            '', 'its columns, where others than t, x, y, phi, t, x, y, z, rx, ... or t, q1, ...'
        ),
    ]
    units: Annotated[tuple[str, ...], Field('', 'its units, where others than s, m, rad')]
    thinned: Annotated[str, Field('', 'what was left out of it')]
    space: Annotated[
        Literal['pose', 'joints', 'quaternions'],
        Field('', 'what the points are: poses, actuated joints, or x, y, z and a quaternion each'),
    ]
    periodic: Annotated[bool, Field('', 'again and again; the last point equals the first')]
    smoothing: Annotated[
        float, Field('s', '0: through the points; else near them, faster motion is left out', 0.0)
    ]


class Spline(NamedTuple):
    """Polynomials of degree 5 from knot to knot."""

    knots: np.ndarray[Any, np.dtype[np.float64]]  # times [s], shape (K + 1,)
    # of the powers 5 to 0 of the time since the knot, shape (K, 6, m)
    coefficients: np.ndarray[Any, np.dtype[np.float64]]
    periodic: bool  # whether it repeats itself


def prepare(parameters: Parameters) -> Spline:
    """Compute the spline.

    Raises:
        InputError: numbers of times and points do not fit, a time is not after the one before, a
            periodic motion does not end where it begins, or the times are too uneven.
    """
    times, points = _checked(parameters)
    from trajectory_gen import spline  # scipy takes long to load, and few motions need it

    made = spline.fit(times, points, parameters.periodic, parameters.smoothing)
    offset = np.abs(made(times) - points).max()
    if not np.isfinite(offset) or (
        not parameters.smoothing and offset > RESIDUAL * np.abs(points).max()
    ):
        raise InputError(
            'waypoints.times are too uneven for a spline through all points; leave some out',
            'waypoints.times',
        )
    return Spline(times, spline.polynomials(made, times), parameters.periodic)


def _checked(parameters: Parameters) -> tuple[Any, Any]:
    """Times, shape (N,), and points, shape (N, m)."""
    count, numbers = len(parameters.times), len(parameters.points)
    if not 2 <= count <= MAX_POINTS:
        raise InputError(
            f'waypoints.times must hold from 2 to {MAX_POINTS} numbers, not {count}',
            'waypoints.times',
        )
    if not numbers or numbers % count:
        raise InputError(
            f'waypoints.points must hold one pose for each of the {count} times, '
            f'not {numbers} numbers',
            'waypoints.points',
        )
    times, points = np.array(parameters.times), np.reshape(parameters.points, (count, -1))
    early = np.flatnonzero(np.diff(times) <= 0.0)
    if early.size:
        k = int(early[0])
        raise InputError(
            f'waypoints.times must increase; {times[k + 1]:.10g} s is not after {times[k]:.10g} s',
            'waypoints.times',
        )
    if parameters.periodic and (points[0] != points[-1]).any():
        raise InputError(
            'waypoints.periodic needs a last point that equals the first, not '
            f'{points[-1].tolist()} and {points[0].tolist()}',
            'waypoints.periodic',
        )
    return times, points


@kernel
def motion(spline: Spline, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s] since the first point."""
    knots, coefficients = spline.knots, spline.coefficients
    length = knots[-1] - knots[0]
    resting = not spline.periodic and not 0.0 < t < length
    t = t % length if spline.periodic else min(max(t, 0.0), length)
    t += knots[0]
    k, after = 0, len(knots) - 1
    while after - k > 1:  # np.searchsorted would make every process load scipy, which takes long
        middle = (k + after) // 2
        if knots[middle] <= t:
            k = middle
        else:
            after = middle
    u = t - knots[k]
    m = coefficients.shape[2]
    pose, rate, acceleration = np.empty(m), np.zeros(m), np.zeros(m)
    for i in range(m):
        c5, c4, c3, c2, c1, c0 = coefficients[k, :, i]
        pose[i] = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        if not resting:
            rate[i] = c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
            acceleration[i] = 2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))
    return PoseMotion(pose, rate, acceleration)


def span(spline: Spline) -> float:
    """Time after which nothing new happens [s]."""
    return float(spline.knots[-1] - spline.knots[0])
