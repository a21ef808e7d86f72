"""Straight line from rest to rest with a quintic time law (the paper's case 2)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import line_between, quintic


class Parameters(NamedTuple):
    """From `start` to `end` in `duration`, then at rest; phi constant."""

    start: Annotated[tuple[float, ...], Field('m', 'first point: x, y, or a pose in space')]
    end: Annotated[tuple[float, ...], Field('m', 'last point: x, y, or a pose in space')]
    duration: Annotated[float, Field('s', 'time from the first to the last point', 1e-3)]
    phi: Annotated[float, Field('rad', 'platform angle, with points x, y')]


class Line(NamedTuple):
    """First pose, and way to the last one, each shape (m,); duration [s]."""

    start: Array
    way: Array
    duration: float


def prepare(parameters: Parameters) -> Line:
    """The line of the parameters.

    Raises:
        InputError: the points are no poses of one robot.
    """
    start, end, duration, phi = parameters
    return Line(*line_between('line', ('start', 'end'), start, end, phi), duration)


@kernel
def motion(line: Line, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    s, s_dot, s_ddot = quintic(line.duration, t)
    return PoseMotion(line.start + s * line.way, s_dot * line.way, s_ddot * line.way)


def span(line: Line) -> float:
    """Time after which nothing new happens [s]."""
    return line.duration
