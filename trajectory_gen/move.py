"""Move from one pose to another, all coordinates in step, with a quintic time law; any robot."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import with_arrays
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import quintic


class Parameters(NamedTuple):
    """From `start` to `end` in `duration`, then at rest."""

    start: Annotated[tuple[float, ...], Field('', 'first pose, in the units of the robot')]
    end: Annotated[tuple[float, ...], Field('', 'last pose, in the units of the robot')]
    duration: Annotated[float, Field('s', 'time from the first to the last pose', 1e-3)]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    s, s_dot, s_ddot = quintic(parameters.duration, t)
    start: Any = parameters.start
    way = parameters.end - start
    return PoseMotion(start + s * way, s_dot * way, s_ddot * way)


def validate(parameters: Parameters) -> Parameters:
    """Return the parameters if both poses have the same number of coordinates.

    Raises:
        InputError: they do not.
    """
    if len(parameters.start) != len(parameters.end):
        raise InputError(
            f'move.start and move.end must be poses of one robot, not of '
            f'{len(parameters.start)} and {len(parameters.end)} coordinates',
            'move',
        )
    return parameters


prepare = with_arrays  # of which `motion` takes the lists


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]."""
    return parameters.duration
