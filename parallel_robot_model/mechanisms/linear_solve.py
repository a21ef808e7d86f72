"""Linear systems by LU with partial pivoting, in place: the same bits on every machine.

The blocks of closed chains are sparse: what is zero is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import Index

WIDTH = 3  # right sides that are solved together
SMALLEST = 1e-10  # pivot, of a matrix whose elements are about 1, of one that has full rank


class Factors(NamedTuple):
    """A matrix of shape (n, n), then its LU.

    Attributes:
        a: The matrix; then both factors, with the reciprocals of the pivots in the diagonal.
        row: Row of the matrix that is a row of its factors, shape (n,).
        filled: Columns of the elements of a row that are not zero: those right of the diagonal,
            and from the end those left of it, shape (n, n).
        left: Number of those left of the diagonal, shape (n,).
        right: Number of those right of it, shape (n,).
        room: Right sides in the order of the factors, shape (n, WIDTH).
    """

    a: Array
    row: Index
    filled: Index
    left: Index
    right: Index
    room: Array


def factors(n: int) -> Factors:
    """Room for the factors of a matrix of shape (n, n)."""
    row, left, count = np.zeros((3, n), np.int64)
    return Factors(
        np.zeros((n, n)), row, np.zeros((n, n), np.int64), left, count, np.zeros((n, WIDTH))
    )


@inner
def factor(system: Factors) -> int:
    """Replace the matrix by its LU.

    Returns:
        Sign of the determinant, 0 if a pivot is too small or not a number.
    """
    a, row = system.a, system.row
    n, sign = len(a), 1
    for i in range(n):
        row[i] = i
    for c in range(n):
        p = c
        best = abs(a[c, c])
        for i in range(c + 1, n):
            if abs(a[i, c]) > best:
                best, p = abs(a[i, c]), i
        if not best > SMALLEST:
            return 0
        if p != c:
            sign = -sign
            row[c], row[p] = row[p], row[c]
            for k in range(n):
                a[c, k], a[p, k] = a[p, k], a[c, k]
        if a[c, c] < 0.0:
            sign = -sign
        inverse = 1.0 / a[c, c]
        a[c, c] = inverse
        for i in range(c + 1, n):
            if a[i, c] != 0.0:
                f = a[i, c] * inverse
                a[i, c] = f
                for k in range(c + 1, n):
                    a[i, k] -= f * a[c, k]
    _list_filled(system)
    return sign


@inner
def _list_filled(system: Factors) -> None:
    """List the elements that are not zero."""
    a, filled, last = system.a, system.filled, len(system.a) - 1
    for i in range(last + 1):
        count = 0
        for c in range(i):
            filled[i, last - count] = c
            count += a[i, c] != 0.0
        system.left[i] = count
        count = 0
        for c in range(i + 1, last + 1):
            filled[i, count] = c
            count += a[i, c] != 0.0
        system.right[i] = count


@inner
def solve_vector(system: Factors, b: Array) -> None:
    """Replace a right side, shape (n,), by the solution."""
    a, row, filled, left, right, x = system
    n = len(b)
    for i in range(n):
        total = b[row[i]]
        for k in range(n - left[i], n):
            total -= a[i, filled[i, k]] * x[filled[i, k], 0]
        x[i, 0] = total
    for i in range(n - 1, -1, -1):
        total = x[i, 0]
        for k in range(right[i]):
            total -= a[i, filled[i, k]] * b[filled[i, k]]
        b[i] = total * a[i, i]


@inner
def solve_columns(system: Factors, b: Array) -> None:
    """Replace right sides, shape (n, k), by the solutions; k is a multiple of WIDTH."""
    a, row, filled, left, right, x = system
    n = len(a)
    for j in range(0, b.shape[1], WIDTH):
        for i in range(n):
            s, t, u = b[row[i], j], b[row[i], j + 1], b[row[i], j + 2]
            for k in range(n - left[i], n):
                c = filled[i, k]
                f = a[i, c]
                s, t, u = s - f * x[c, 0], t - f * x[c, 1], u - f * x[c, 2]
            x[i, 0], x[i, 1], x[i, 2] = s, t, u
        for i in range(n - 1, -1, -1):
            s, t, u = x[i, 0], x[i, 1], x[i, 2]
            for k in range(right[i]):
                c = filled[i, k]
                f = a[i, c]
                s, t, u = s - f * b[c, j], t - f * b[c, j + 1], u - f * b[c, j + 2]
            b[i, j], b[i, j + 1], b[i, j + 2] = s * a[i, i], t * a[i, i], u * a[i, i]
