"""Vectors in space as tuples of three numbers, which kernels keep in registers."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner

Triple = tuple[float, float, float]


@inner
def triple(x: Array, i: int) -> Triple:
    """The first three elements of row i."""
    return x[i, 0], x[i, 1], x[i, 2]


@inner
def second_triple(x: Array, i: int) -> Triple:
    """The second three elements of row i."""
    return x[i, 3], x[i, 4], x[i, 5]


@inner
def plus(a: Triple, b: Triple) -> Triple:
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inner
def minus(a: Triple, b: Triple) -> Triple:
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner
def times(a: Triple, s: float) -> Triple:
    """Product with a number."""
    return s * a[0], s * a[1], s * a[2]


@inner
def inner_product(a: Triple, b: Triple) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def crossed(a: Triple, b: Triple) -> Triple:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@inner
def velocity(angular: Triple, linear: Triple, point: Triple) -> Triple:
    """Velocity of a point of a body that moves so; `linear` is that at the world's origin."""
    return plus(linear, crossed(angular, point))


@inner
def turned(rotation: Array, i: int, x: Triple) -> Triple:
    """A vector of frame i in the world."""
    return (
        rotation[i, 0, 0] * x[0] + rotation[i, 0, 1] * x[1] + rotation[i, 0, 2] * x[2],
        rotation[i, 1, 0] * x[0] + rotation[i, 1, 1] * x[1] + rotation[i, 1, 2] * x[2],
        rotation[i, 2, 0] * x[0] + rotation[i, 2, 1] * x[1] + rotation[i, 2, 2] * x[2],
    )


@inner
def in_world(rotation: Array, origin: Array, i: int, x: Triple) -> Triple:
    """A point of frame i, or of the world if it is BASE, in the world."""
    if i < 0:
        return x
    return plus(triple(origin, i), turned(rotation, i, x))


@inner
def set_row(x: Array, i: int, a: Triple, b: Triple) -> None:
    """Write two triples to row i."""
    x[i, 0], x[i, 1], x[i, 2] = a
    x[i, 3], x[i, 4], x[i, 5] = b
