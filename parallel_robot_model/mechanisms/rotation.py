"""Rotation vectors: from and to matrices, and their rates."""

from __future__ import annotations

import math

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.spatial import Triple, crossed, plus, times

SMALL = 0.5  # rad, angle below which series are more accurate


@inner
def rotation_vector(a: Array, b: Array) -> Triple:
    """Rotation vector of a b^T, of an angle up to pi [rad]; both shape (3, 3).

    By the quaternion with the largest of its elements first (Shepperd 1978).
    """
    xx = a[0, 0] * b[0, 0] + a[0, 1] * b[0, 1] + a[0, 2] * b[0, 2]
    xy = a[0, 0] * b[1, 0] + a[0, 1] * b[1, 1] + a[0, 2] * b[1, 2]
    xz = a[0, 0] * b[2, 0] + a[0, 1] * b[2, 1] + a[0, 2] * b[2, 2]
    yx = a[1, 0] * b[0, 0] + a[1, 1] * b[0, 1] + a[1, 2] * b[0, 2]
    yy = a[1, 0] * b[1, 0] + a[1, 1] * b[1, 1] + a[1, 2] * b[1, 2]
    yz = a[1, 0] * b[2, 0] + a[1, 1] * b[2, 1] + a[1, 2] * b[2, 2]
    zx = a[2, 0] * b[0, 0] + a[2, 1] * b[0, 1] + a[2, 2] * b[0, 2]
    zy = a[2, 0] * b[1, 0] + a[2, 1] * b[1, 1] + a[2, 2] * b[1, 2]
    zz = a[2, 0] * b[2, 0] + a[2, 1] * b[2, 1] + a[2, 2] * b[2, 2]
    trace = xx + yy + zz
    if trace >= max(xx, yy, zz):
        w, x, y, z = 1.0 + trace, zy - yz, xz - zx, yx - xy
    elif xx >= yy and xx >= zz:
        w, x, y, z = zy - yz, 1.0 + xx - yy - zz, xy + yx, xz + zx
    elif yy >= zz:
        w, x, y, z = xz - zx, xy + yx, 1.0 + yy - xx - zz, yz + zy
    else:
        w, x, y, z = yx - xy, xz + zx, yz + zy, 1.0 + zz - xx - yy
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 / w if sine < 1e-9 * w else 2.0 * math.atan2(sine, w) / sine
    return factor * x, factor * y, factor * z


@inner
def turn_by(x: Triple, a: Array, out: Array) -> None:
    """Write exp(x) a, the matrix a turned by a rotation vector [rad]; shapes (3, 3)."""
    angle = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    s, c = _sine(angle), _versine(angle)
    for k in range(3):
        y = (a[0, k], a[1, k], a[2, k])
        once = crossed(x, y)
        turned = plus(y, plus(times(once, s), times(crossed(x, once), c)))
        out[0, k], out[1, k], out[2, k] = turned


@inner
def _sine(angle: float) -> float:
    """sin(t) / t."""
    return math.sin(angle) / angle if angle > 1e-9 else 1.0


@inner
def _versine(angle: float) -> float:
    """(1 - cos t) / t^2."""
    half = _sine(0.5 * angle)
    return 0.5 * half * half


@inner
def _third(angle: float) -> float:
    """(t - sin t) / t^3."""
    if angle < SMALL:
        return _series(angle, (20.0, 42.0, 72.0, 110.0, 156.0, 210.0)) / 6.0
    return (angle - math.sin(angle)) / (angle * angle * angle)


@inner
def vector_rate(x: Triple, angular: Triple) -> Triple:
    """Rate of a rotation vector at an angular velocity: by the inverse of the left Jacobian.

    J = 1 + (1 - cos t) / t^2 [x] + (t - sin t) / t^3 [x]^2 with t = |x|.

    Source:
        Sola, Deray, Atchuthan (2018), A micro Lie theory for state estimation, eqs. (145), (146).
    """
    return vector_rate_by(x, bending(x), angular)


@inner
def vector_rate_by(x: Triple, bent: float, angular: Triple) -> Triple:
    """The same with the `bending` of the vector, for many angular velocities."""
    once = crossed(x, angular)
    twice = crossed(x, once)
    return plus(angular, plus(times(once, -0.5), times(twice, bent)))


@inner
def bending(x: Triple) -> float:
    """(1 - t / 2 cot(t / 2)) / t^2 with t = |x|."""
    angle = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    half = 0.5 * angle
    return 0.25 * (_versine(half) - _third(half)) / _sine(half)


@inner
def jacobian_rate(x: Triple, rate: Triple) -> Triple:
    """Derivative of the left Jacobian, see `vector_rate`, times the rate of the vector."""
    square = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    angle = math.sqrt(square)
    along = x[0] * rate[0] + x[1] * rate[1] + x[2] * rate[2]
    once = crossed(x, rate)
    c = _third(angle)
    b_rate = along * _versine_slope(angle)
    c_rate = along * _third_slope(angle)
    # d/dt [x]^2 rate = rate x (x x rate) + x x (rate x rate)
    twice = times(crossed(rate, once), c)
    return plus(times(once, b_rate), plus(times(crossed(x, once), c_rate), twice))


@inner
def _versine_slope(angle: float) -> float:
    """Derivative of (1 - cos t) / t^2 by t, over t."""
    if angle < SMALL:
        return -_series(angle, (15.0, 112.0 / 3.0, 67.5, 105.6, 455.0 / 3.0)) / 12.0
    return (_sine(angle) - 2.0 * _versine(angle)) / (angle * angle)


@inner
def _third_slope(angle: float) -> float:
    """Derivative of (t - sin t) / t^3 by t, over t."""
    if angle < SMALL:
        return -_series(angle, (21.0, 48.0, 82.5, 124.8, 175.0)) / 60.0
    return (_versine(angle) - 3.0 * _third(angle)) / (angle * angle)


@inner
def _series(angle: float, divisors: tuple[float, ...]) -> float:
    """1 - t^2 / d1 (1 - t^2 / d2 (1 - ...))."""
    total = 1.0
    for k in range(len(divisors) - 1, -1, -1):
        total = 1.0 - angle * angle / divisors[k] * total
    return total
