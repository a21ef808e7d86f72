"""Planes, straight ways and the progress along them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cosine, dot, kernel, sine, vector
from parallel_robot_model.robots.contract import PoseMotion

# Planes and straight ways in the coordinates of the robot's pose, along which motions lie.

Vector = tuple[float, float]
SPACE = 3  # coordinates of a place in space, with which a pose of three or more begins


def length_of(way: Sequence[float] | Array) -> float:
    """Length of a way; that of numpy is other bits on another processor."""
    return math.sqrt(dot(vector(way), vector(way)))


class Plane(NamedTuple):
    """Origin, first and second axis in coordinates of the pose, each shape (m,)."""

    origin: Array
    first: Array
    second: Array


def plane_of(
    key: str,
    center: tuple[float, ...],
    phi: float,
    normal: tuple[float, float, float],
    angle: float = 0.0,
) -> Plane:
    """The plane of a motion.

    Args:
        key: Key of the centre, for messages.
        center: x and y [m], with `phi` the pose of a robot in a plane; or a pose that begins with
            x, y and z [m] and keeps all else.
        phi: Platform angle [rad].
        normal: Normal of the plane in space; any length but zero.
        angle: Direction of the first axis [rad]; from x, or in space from x as the plane sees it.

    Raises:
        InputError: the centre is a single number, or the normal is zero.
    """
    c, s = cosine(angle), sine(angle)
    if len(center) == len('xy'):
        origin = np.array([*center, phi])
        return Plane(origin, np.array([c, s, 0.0]), np.array([-s, c, 0.0]))
    if len(center) < SPACE:
        what = f'{key} must be [x, y], or a pose that begins with x, y, z, not {list(center)}'
        raise InputError(what, key)
    length = length_of(normal)
    if not length > 0.0:
        named = f'{key.partition(".")[0]}.normal'
        raise InputError(f'{named} must have a direction, not {list(normal)}', named)
    n = np.array(normal) / length
    x = np.eye(SPACE)[int(abs(n[0]) > math.cos(math.pi / 6.0))]  # not along the normal
    u = x - dot(vector(x), vector(n)) * n
    u /= length_of(u)
    v = np.cross(n, u)
    first, second = np.zeros((2, len(center)))
    first[:SPACE], second[:SPACE] = c * u + s * v, c * v - s * u
    return Plane(np.array(center), first, second)


def line_between(
    group: str,
    names: tuple[str, str],
    first: tuple[float, ...],
    last: tuple[float, ...],
    phi: float,
) -> tuple[Array, Array]:
    """First pose of a straight way, and the way to the last one, each shape (m,).

    Args:
        group: Group of the keys of both points, for messages.
        names: Of both keys.
        first: x and y [m], with `phi` the pose of a robot in a plane; or a pose in space.
        last: The same.
        phi: Platform angle [rad].

    Raises:
        InputError: the points are no poses of one robot.
    """
    count = len(first)
    if len(last) != count or count < len('xy'):
        what = 'must be [x, y] both, or poses that begin with x, y, z'
        raise InputError(f'{group}.{names[0]} and {group}.{names[1]} {what}', group)
    start = np.array([*first, phi] if count == len('xy') else first)
    way = np.zeros_like(start)
    way[:count] = np.array(last) - np.array(first)
    return start, way


@kernel
def drawn(plane: Plane, place: Vector, rate: Vector, acceleration: Vector) -> PoseMotion:
    """Motion of the pose from that in the plane.

    Args:
        plane: The plane.
        place: Along the first and the second axis [m].
        rate: Its first derivative.
        acceleration: Its second derivative.
    """
    u, v = plane.first, plane.second
    return PoseMotion(
        plane.origin + place[0] * u + place[1] * v,
        0.0 + rate[0] * u + rate[1] * v,
        0.0 + acceleration[0] * u + acceleration[1] * v,
    )


# Progress along a path from rest to rest.


@kernel
def quintic(duration: float, t: float) -> tuple[float, float, float]:
    """Fraction of the path s = 10 u^3 - 15 u^4 + 6 u^5, u = t / duration, with two derivatives.

    Before the start s is 0, after the end 1.

    Args:
        duration: Time from the start to the end of the path [s].
        t: Time since the start [s].
    """
    T = duration
    u = min(max(t / T, 0.0), 1.0)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    s_dot = 30.0 * u**2 * (1.0 - u) ** 2 / T
    s_ddot = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / T**2
    return s, s_dot, s_ddot


@kernel
def trapezoid(speed: float, acceleration: float, t: float) -> tuple[float, float, float]:
    """Fraction of the path with two derivatives, the rate of trapezoidal shape.

    It accelerates, keeps its rate if there is time for that, and slows down. Before the start the
    fraction is 0, after the end 1.

    Args:
        speed: Largest rate [1/s].
        acceleration: Acceleration and deceleration [1/s^2].
        t: Time since the start [s].
    """
    slope = min(speed / acceleration, 1.0 / math.sqrt(acceleration))
    rate = acceleration * slope
    end = slope + 1.0 / rate
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    if t < slope:
        return 0.5 * acceleration * t**2, acceleration * t, acceleration
    if t <= end - slope:
        return rate * (t - 0.5 * slope), rate, 0.0
    if t < end:
        left = end - t
        return 1.0 - 0.5 * acceleration * left**2, acceleration * left, -acceleration
    return 1.0, 0.0, 0.0
