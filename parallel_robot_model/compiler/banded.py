"""Linear equations with a matrix that is zero far from its diagonal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler.kernels import kernel

Index = NDArray[np.integer]


def solve_sparse(rows: Index, columns: Index, values: Array, right: Array) -> Array:
    """Solution x of A x = b by Gauss with partial pivoting; the same bits on every processor.

    Args:
        rows: Row of each element of A that is not zero, whole numbers, shape (K,).
        columns: Its column, shape (K,).
        values: The elements, shape (K,).
        right: The right sides b, shape (n, m).

    Returns:
        x, shape (n, m); not finite where A is singular.
    """
    if not len(values):
        return np.full_like(right, np.nan)
    lower = int(max(0, np.max(rows - columns)))
    upper = int(max(0, np.max(columns - rows)))
    band = np.zeros((len(right), 2 * lower + upper + 1))
    band[rows, columns - rows + lower] = values
    solution = np.array(right, np.float64, order='C')
    _eliminate(band, solution, lower, upper)
    return solution


def solve_full(matrix: Array, right: Array) -> Array:
    """Solution x of A x = b, A of shape (n, n), b of shape (n,), as :func:`solve_sparse`."""
    rows, columns = np.indices(matrix.shape).reshape(2, -1)
    values = np.ascontiguousarray(matrix).ravel()
    return solve_sparse(rows, columns, values, np.reshape(right, (-1, 1)))[:, 0]


@kernel
def _eliminate(band: Array, x: Array, lower: int, upper: int) -> None:
    """Solve in place; element (i, j) of the matrix lies in band[i, j - i + lower]."""
    n, m = x.shape
    for i in range(n):
        end = min(n, i + lower + upper + 1)
        last = min(n, i + lower + 1)
        pivot = i
        for r in range(i + 1, last):
            if abs(band[r, i - r + lower]) > abs(band[pivot, i - pivot + lower]):
                pivot = r
        if pivot != i:
            for j in range(i, end):
                held = band[i, j - i + lower]
                band[i, j - i + lower] = band[pivot, j - pivot + lower]
                band[pivot, j - pivot + lower] = held
            for k in range(m):
                held = x[i, k]
                x[i, k] = x[pivot, k]
                x[pivot, k] = held
        for r in range(i + 1, last):
            share = band[r, i - r + lower] / band[i, lower]
            if share != 0.0:
                for j in range(i + 1, end):
                    band[r, j - r + lower] -= share * band[i, j - i + lower]
                for k in range(m):
                    x[r, k] -= share * x[i, k]
    for i in range(n - 1, -1, -1):
        end = min(n, i + lower + upper + 1)
        for k in range(m):
            total = x[i, k]
            for j in range(i + 1, end):
                total -= band[i, j - i + lower] * x[j, k]
            x[i, k] = total / band[i, lower]
