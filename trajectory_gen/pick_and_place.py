"""There and back between two poses, again and again, each time lifted on the way."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import SPACE, length_of, line_between, quintic


class Parameters(NamedTuple):
    """From `pick` to `place` in `duration`, after `dwell` back, and so on.

    Lifting takes `rise`, and so does lowering; the way begins in the middle of the one and ends
    in the middle of the other. All three have quintic time laws, so accelerations do not jump.
    """

    pick: Annotated[tuple[float, ...], Field('m', 'first point: x, y, or a pose in space')]
    place: Annotated[tuple[float, ...], Field('m', 'other point: x, y, or a pose in space')]
    height: Annotated[float, Field('m', 'by which it is lifted on the way', 0.0)]
    direction: Annotated[
        tuple[float, ...], Field('', 'in which it is lifted; []: z, in a plane y')
    ]
    duration: Annotated[float, Field('s', 'time from one point to the other', 1e-3)]
    rise: Annotated[float, Field('s', 'time of lifting, and of lowering', 1e-3)]
    dwell: Annotated[float, Field('s', 'rest at each point', 0.0)]
    phi: Annotated[float, Field('rad', 'platform angle, with points x, y')]


class Route(NamedTuple):
    """First pose, way to the other and lift, each shape (m,); times as in Parameters [s]."""

    start: Array
    way: Array
    lift: Array
    duration: float
    rise: float
    dwell: float


def prepare(parameters: Parameters) -> Route:
    """The way of the parameters.

    Raises:
        InputError: the points are no poses of one robot, the direction is none, or lifting and
            lowering take longer than the way.
    """
    pick, place, height, direction, duration, rise, dwell, phi = parameters
    start, way = line_between('pick_and_place', ('pick', 'place'), pick, place, phi)
    size = min(len(pick), SPACE)
    axis = np.array(direction or np.eye(size)[-1])
    if len(axis) != size or not length_of(axis) > 0.0:
        what = f'must be [] or {size} numbers, not all zero, not {list(direction)}'
        raise InputError(f'pick_and_place.direction {what}', 'pick_and_place.direction')
    if 2.0 * rise > duration:
        what = f'must be at most half of the duration, {0.5 * duration:g} s, not {rise:g}'
        raise InputError(f'pick_and_place.rise {what}', 'pick_and_place.rise')
    lift = np.zeros_like(start)
    lift[:size] = height * axis / length_of(axis)
    return Route(start, way, lift, duration, rise, dwell)


@kernel
def motion(way: Route, t: float) -> PoseMotion:
    """Pose with two derivatives at time `t` [s]."""
    one_way = way.duration + way.dwell
    t = t % (2.0 * one_way)
    back = t >= one_way
    t = min(t - one_way if back else t, way.duration)
    s, s_dot, s_ddot = quintic(way.duration - way.rise, t - 0.5 * way.rise)
    up, up_dot, up_ddot = quintic(way.rise, t)
    low, low_dot, low_ddot = quintic(way.rise, t - way.duration + way.rise)
    if back:
        s, s_dot, s_ddot = 1.0 - s, -s_dot, -s_ddot
    return PoseMotion(
        way.start + s * way.way + (up - low) * way.lift,
        s_dot * way.way + (up_dot - low_dot) * way.lift,
        s_ddot * way.way + (up_ddot - low_ddot) * way.lift,
    )


def span(way: Route) -> float:
    """Time after which nothing new happens [s]: there and back."""
    return 2.0 * (way.duration + way.dwell)
