"""Small matrices as kernels: always the same operations in the same order, so the same bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel

Array = NDArray[np.float64]


@kernel
def determinant(a: Array) -> float:
    """Determinant of a matrix of shape (3, 3)."""
    return (
        a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
        - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
        + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
    )


@kernel
def inverse(a: Array) -> Array:
    """Inverse of a matrix of shape (3, 3) by its adjugate; not finite when singular."""
    b = np.empty((3, 3))
    b[0, 0] = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    b[0, 1] = a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]
    b[0, 2] = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    b[1, 0] = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    b[1, 1] = a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]
    b[1, 2] = a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]
    b[2, 0] = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    b[2, 1] = a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]
    b[2, 2] = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    scale = 1.0 / (a[0, 0] * b[0, 0] + a[0, 1] * b[1, 0] + a[0, 2] * b[2, 0])
    for i in range(3):
        for j in range(3):
            b[i, j] *= scale
    return b


@kernel
def multiply(a: Array, x: Array) -> Array:
    """Product of a matrix (n, n) and a vector (n,), summed in order: the same bits everywhere."""
    y = np.empty(len(x))
    for i in range(len(x)):
        total = 0.0
        for j in range(len(x)):
            total += a[i, j] * x[j]
        y[i] = total
    return y


@kernel
def multiply_transposed(a: Array, x: Array) -> Array:
    """Product a^T x of a matrix (n, n) and a vector (n,), summed in order."""
    y = np.zeros(len(x))
    for i in range(len(x)):
        for j in range(len(x)):
            y[j] += a[i, j] * x[i]
    return y
