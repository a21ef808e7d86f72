"""Straight line from rest to rest with limits of speed and acceleration; any robot.

The acceleration jumps, which no law follows without an error: `move` has a smooth one.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import with_arrays
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import trapezoid

SMALLEST = 1e-6  # of the limits


class Parameters(NamedTuple):
    """From `start` to `end`, as fast as the limits of all coordinates allow, then at rest."""

    start: Annotated[tuple[float, ...], Field('', 'first pose, in the units of the robot')]
    end: Annotated[tuple[float, ...], Field('', 'last pose, in the units of the robot')]
    speed: Annotated[
        tuple[float, ...], Field('', 'largest rate of each coordinate, per second', SMALLEST)
    ]
    acceleration: Annotated[
        tuple[float, ...],
        Field('', 'largest acceleration of each coordinate, per second squared', SMALLEST),
    ]


@kernel
def _limits(parameters: Parameters) -> tuple[float, float]:
    """Largest rate [1/s] and acceleration [1/s^2] of the fraction of the way; 0 without one."""
    start, end = parameters.start, parameters.end
    speeds, accelerations = parameters.speed, parameters.acceleration
    speed = acceleration = np.inf
    for i in range(len(start)):
        way = abs(end[i] - start[i])
        if way > 0.0:
            speed = min(speed, speeds[i] / way)
            acceleration = min(acceleration, accelerations[i] / way)
    return (speed, acceleration) if speed < np.inf else (0.0, 0.0)


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    start: Any = parameters.start
    way = parameters.end - start
    speed, acceleration = _limits(parameters)
    s, s_dot, s_ddot = trapezoid(speed, acceleration, t) if speed > 0.0 else (0.0, 0.0, 0.0)
    return PoseMotion(start + s * way, s_dot * way, s_ddot * way)


def validate(parameters: Parameters) -> Parameters:
    """Return the parameters if all four have the same number of coordinates.

    Raises:
        InputError: they do not, or there is none.
    """
    counts = [len(numbers) for numbers in parameters]
    if min(counts) != max(counts) or not counts[0]:
        given = ', '.join(map(str, counts[:-1]))
        raise InputError(
            'trapezoid.start, end, speed and acceleration must hold one number for each '
            f'coordinate of the robot, not {given} and {counts[-1]}',
            'trapezoid',
        )
    return parameters


prepare = with_arrays  # of which `motion` takes the lists


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]."""
    speed, acceleration = _limits(parameters)
    if not speed:
        return 0.0
    slope = min(speed / acceleration, acceleration**-0.5)
    return float(slope + 1.0 / (acceleration * slope))
