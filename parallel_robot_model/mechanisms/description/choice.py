"""Independent rows of a matrix, chosen in the same way on every computer."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array

TOLERANCE = 1e-5  # singular values, relative to the largest, that count as zero
TIE = 1e-6  # relative difference of lengths below which the first row is taken


def rank(matrix: Array) -> int:
    """How many rows are independent of each other."""
    if not matrix.size:
        return 0
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > TOLERANCE * max(values[0], TOLERANCE)))


def null_space(matrix: Array) -> Array:
    """An orthonormal basis of what a matrix makes zero, shape (columns, k)."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    return np.asarray(np.linalg.svd(matrix)[2][rank(matrix) :].T)


def independent(matrix: Array, count: int) -> list[int]:
    """Rows by a Gram-Schmidt process with pivots: the longest of what is left comes next.

    Args:
        matrix: Its rows, of rank `count` or more.
        count: How many rows are chosen.

    Returns:
        Their indices, ascending.
    """
    left, chosen = matrix.copy(), []
    for _ in range(count):
        lengths = np.linalg.norm(left, axis=1)
        pivot = int(np.argmax(lengths >= (1.0 - TIE) * lengths.max()))
        unit = left[pivot] / lengths[pivot]
        left -= np.outer(left @ unit, unit)
        left[pivot] = 0.0
        chosen.append(pivot)
    return sorted(chosen)
