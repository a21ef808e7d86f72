"""Vectors in space: rows of arrays as vectors, rotations, copies, quaternions."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import arctangent, cosine, cross, dot, internal, sine, vector


@internal
def triple(x: Array, i: int, k: int = 0) -> Array:
    """Three elements of row i from element k on."""
    return vector((x[i, k], x[i, k + 1], x[i, k + 2]))


@internal
def column(x: Array, k: int) -> Array:
    """Column k of an array of three rows."""
    return vector((x[0, k], x[1, k], x[2, k]))


@internal
def of_array(x: Array) -> Array:
    """An array of three elements."""
    return vector((x[0], x[1], x[2]))


@internal
def nothing() -> Array:
    """The vector of zeros."""
    return vector((0.0, 0.0, 0.0))


@internal
def matrix(x: Array) -> Array:
    """An array of shape (3, 3)."""
    return vector((triple(x, 0), triple(x, 1), triple(x, 2)))


@internal
def velocity(angular: Array, linear: Array, point: Array) -> Array:
    """Velocity of a point of a body that moves so; `linear` is that at the world's origin."""
    return linear + cross(angular, point)


@internal
def in_world(rotation: Array, origin: Array, i: int, x: Array) -> Array:
    """A point of frame i, or of the world if it is BASE, in the world."""
    if i < 0:
        return x
    return triple(origin, i) + matrix(rotation[i]) @ x


@internal
def put(x: Array, i: int, k: int, a: Array) -> None:
    """Write a vector to row i from element k on."""
    x[i, k], x[i, k + 1], x[i, k + 2] = a[0], a[1], a[2]


# Rotation vectors: from and to matrices, and their rates.

SERIES_BELOW = 0.5  # rad, angle below which series are more accurate


@internal
def rotation_vector(a: Array, b: Array) -> Array:
    """Rotation vector of a b^T, of an angle up to pi [rad]; both arrays of shape (3, 3).

    By the quaternion with the largest of its elements first (Shepperd 1978).
    """
    E = matrix(a) @ vector((column(b, 0), column(b, 1), column(b, 2)))
    xx, xy, xz, yx, yy, yz = E[0, 0], E[0, 1], E[0, 2], E[1, 0], E[1, 1], E[1, 2]
    zx, zy, zz = E[2, 0], E[2, 1], E[2, 2]
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
    return factor * vector((x, y, z))


@internal
def rotate_by(x: Array, a: Array, out: Array) -> None:
    """Write exp(x) a, the matrix a turned by a rotation vector [rad]; shapes (3, 3)."""
    angle = math.sqrt(dot(x, x))
    s, c = _sine(angle), _versine(angle)
    for k in range(3):
        y = column(a, k)
        once = cross(x, y)
        turned = y + (s * once + c * cross(x, once))
        out[0, k], out[1, k], out[2, k] = turned[0], turned[1], turned[2]


@internal
def _sine(angle: float) -> float:
    """sin(t) / t."""
    return math.sin(angle) / angle if angle > 1e-9 else 1.0


@internal
def _versine(angle: float) -> float:
    """(1 - cos t) / t^2."""
    half = _sine(0.5 * angle)
    return 0.5 * half * half


@internal
def _third(angle: float) -> float:
    """(t - sin t) / t^3."""
    if angle < SERIES_BELOW:
        return _series(angle, (20.0, 42.0, 72.0, 110.0, 156.0, 210.0)) / 6.0
    return (angle - math.sin(angle)) / (angle * angle * angle)


@internal
def vector_rate(x: Array, angular: Array) -> Array:
    """Rate of a rotation vector at an angular velocity: by the inverse of the left Jacobian.

    J = 1 + (1 - cos t) / t^2 [x] + (t - sin t) / t^3 [x]^2 with t = |x|.

    Source:
        Sola, Deray, Atchuthan (2018), A micro Lie theory for state estimation, eqs. (145), (146).
    """
    return vector_rate_by(x, bending(x), angular)


@internal
def vector_rate_by(x: Array, bent: float, angular: Array) -> Array:
    """The same with the `bending` of the vector, for many angular velocities."""
    once = cross(x, angular)
    return angular + (-0.5 * once + bent * cross(x, once))


@internal
def bending(x: Array) -> float:
    """(1 - t / 2 cot(t / 2)) / t^2 with t = |x|."""
    half = 0.5 * math.sqrt(dot(x, x))
    return 0.25 * (_versine(half) - _third(half)) / _sine(half)


@internal
def jacobian_rate(x: Array, rate: Array) -> Array:
    """Derivative of the left Jacobian, see `vector_rate`, times the rate of the vector."""
    angle, along, once = math.sqrt(dot(x, x)), dot(x, rate), cross(x, rate)
    b_rate = along * _versine_slope(angle)
    c_rate = along * _third_slope(angle)
    # d/dt [x]^2 rate = rate x (x x rate) + x x (rate x rate)
    return b_rate * once + (c_rate * cross(x, once) + _third(angle) * cross(rate, once))


@internal
def _versine_slope(angle: float) -> float:
    """Derivative of (1 - cos t) / t^2 by t, over t."""
    if angle < SERIES_BELOW:
        return -_series(angle, (15.0, 112.0 / 3.0, 67.5, 105.6, 455.0 / 3.0)) / 12.0
    return (_sine(angle) - 2.0 * _versine(angle)) / (angle * angle)


@internal
def _third_slope(angle: float) -> float:
    """Derivative of (t - sin t) / t^3 by t, over t."""
    if angle < SERIES_BELOW:
        return -_series(angle, (21.0, 48.0, 82.5, 124.8, 175.0)) / 60.0
    return (_versine(angle) - 3.0 * _third(angle)) / (angle * angle)


@internal
def _series(angle: float, divisors: tuple[float, ...]) -> float:
    """1 - t^2 / d1 (1 - t^2 / d2 (1 - ...))."""
    total = 1.0
    for k in range(len(divisors) - 1, -1, -1):
        total = 1.0 - angle * angle / divisors[k] * total
    return total


# Filling and copying arrays element by element: compiled slices take longer, and may allocate.


@internal
def copy(x: Array, out: Array) -> None:
    """Copy an array of one dimension."""
    for i in range(len(out)):
        out[i] = x[i]


@internal
def copy_matrix(x: Array, out: Array) -> None:
    """Copy the first rows and columns of an array of two dimensions."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = x[i, k]


@internal
def clear(out: Array) -> None:
    """Fill an array of one dimension with zeros."""
    for i in range(len(out)):
        out[i] = 0.0


@internal
def clear_matrix(out: Array) -> None:
    """Fill an array of two dimensions with zeros."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = 0.0


# Quaternions x, y, z, w of rotations, from and to rotation vectors, by arrays.
#
# As scipy's, with the same bits on every processor: poses in bags hold them.

SMALL_ANGLE = 1e-9  # rad, angle below which the sine is the angle


def quaternions_of_vectors(vectors: Array) -> Array:
    """Quaternions of rotation vectors [rad], shapes (N, 4) and (N, 3)."""
    angle = lengths(vectors)
    share = np.where(angle > SMALL_ANGLE, sine(0.5 * angle) / np.maximum(angle, SMALL_ANGLE), 0.5)
    return np.column_stack([share[:, np.newaxis] * vectors, cosine(0.5 * angle)])


def vectors_of_quaternions(quaternions: Array) -> Array:
    """Rotation vectors [rad] of quaternions of any length, shapes (N, 3) and (N, 4)."""
    turned = np.where(quaternions[:, 3:] < 0.0, -quaternions, quaternions)
    size = lengths(turned[:, :3])
    angle = 2.0 * arctangent(size, np.ascontiguousarray(turned[:, 3]))
    straight = size > SMALL_ANGLE * turned[:, 3]
    share = np.where(straight, angle, 2.0) / np.where(straight, size, turned[:, 3])
    return np.asarray(share[:, np.newaxis] * turned[:, :3])


def quaternion_of_matrix(matrix: Array) -> Array:
    """Quaternion of a rotation, shapes (4,) and (3, 3).

    Source:
        Shepperd (1978), Quaternion from rotation matrix, J. Guidance and Control 1(3).
    """
    diagonal = [float(matrix[k, k]) for k in range(3)]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    first = max(range(4), key=[*diagonal, trace].__getitem__)
    found = np.empty(4)
    i, j, k = first % 3, (first + 1) % 3, (first + 2) % 3
    if first == 3:
        found[3] = 1.0 + trace
        found[i] = matrix[k, j] - matrix[j, k]
        found[j] = matrix[i, k] - matrix[k, i]
        found[k] = matrix[j, i] - matrix[i, j]
    else:
        found[i] = 1.0 - trace + 2.0 * diagonal[i]
        found[j] = matrix[j, i] + matrix[i, j]
        found[k] = matrix[k, i] + matrix[i, k]
        found[3] = matrix[k, j] - matrix[j, k]
    x, y, z, w = found.tolist()
    return found / math.sqrt(x * x + y * y + z * z + w * w)


def quaternion_product(one: Array, other: Array) -> Array:
    """Quaternions of the second rotation, then the first, shape (N, 4)."""
    (a, b, c, d), (x, y, z, w) = np.atleast_2d(one).T, np.atleast_2d(other).T
    return np.stack(
        [
            d * x + a * w + b * z - c * y,
            d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w,
            d * w - a * x - b * y - c * z,
        ],
        axis=1,
    )


def lengths(vectors: Array) -> Array:
    """Lengths of vectors, shapes (N,) and (N, 3)."""
    x, y, z = np.ascontiguousarray(vectors.T)
    return np.sqrt(x * x + y * y + z * z)
