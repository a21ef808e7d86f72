"""Quaternions x, y, z, w of rotations, from and to rotation vectors, by arrays.

As scipy's, with the same bits on every processor: poses in bags hold them.
"""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import arctangent, cosine, sine

SMALL = 1e-9  # rad, angle below which the sine is the angle


def of_vectors(vectors: Array) -> Array:
    """Quaternions of rotation vectors [rad], shapes (N, 4) and (N, 3)."""
    angle = lengths(vectors)
    share = np.where(angle > SMALL, sine(0.5 * angle) / np.maximum(angle, SMALL), 0.5)
    return np.column_stack([share[:, np.newaxis] * vectors, cosine(0.5 * angle)])


def vectors_of(quaternions: Array) -> Array:
    """Rotation vectors [rad] of quaternions of any length, shapes (N, 3) and (N, 4)."""
    turned = np.where(quaternions[:, 3:] < 0.0, -quaternions, quaternions)
    size = lengths(turned[:, :3])
    angle = 2.0 * arctangent(size, np.ascontiguousarray(turned[:, 3]))
    straight = size > SMALL * turned[:, 3]
    share = np.where(straight, angle, 2.0) / np.where(straight, size, turned[:, 3])
    return np.asarray(share[:, np.newaxis] * turned[:, :3])


def of_matrix(matrix: Array) -> Array:
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


def product(one: Array, other: Array) -> Array:
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
