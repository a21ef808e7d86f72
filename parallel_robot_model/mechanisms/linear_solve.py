"""Linear systems by LU with partial pivoting, in place: the same bits on every machine.

The blocks of closed chains are sparse: what is zero is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import Index

WIDTH = 3  # right sides that are solved together
SMALLEST = 1e-10  # pivot, of a matrix whose elements are about 1, of one that has full rank


class Factors(NamedTuple):
    """A matrix of shape (n, n), then its LU.

    Attributes:
        a: The matrix; then both factors, with the reciprocals of the pivots in the diagonal.
        row: Row of `a` that is a row of its factors, shape (n,).
        filled: Columns of the elements of a row that are not zero: those right of the diagonal,
            and from the end those left of it, shape (n, n).
        left: Number of those left of the diagonal, shape (n,).
        right: Number of those right of it, shape (n,).
        busy: Rows with an element in a column, in any order, shape (n,).
        room: Right sides in the order of the factors, shape (n, WIDTH).
    """

    a: Array
    row: Index
    filled: Index
    left: Index
    right: Index
    busy: Index
    room: Array


def factors(n: int) -> Factors:
    """Room for the factors of a matrix of shape (n, n)."""
    row, left, count, busy = np.zeros((4, n), np.int64)
    return Factors(
        np.zeros((n, n)), row, np.zeros((n, n), np.int64), left, count, busy, np.zeros((n, WIDTH))
    )


@inner
def factor(system: Factors) -> int:
    """Replace the matrix by its LU; rows stay where they are.

    Returns:
        Sign of the determinant, 0 if a pivot is too small or not a number.
    """
    a, row, filled, left, right = system.a, system.row, system.filled, system.left, system.right
    busy = system.busy
    n, sign = len(a), 1
    for i in range(n):
        row[i] = i
        left[i] = 0
    for c in range(n):
        p, best, rows = c, 0.0, 0
        for i in range(c, n):
            if a[row[i], c] != 0.0:
                busy[rows] = row[i]
                rows += 1
                size = abs(a[row[i], c])
                if size > best:
                    best, p = size, i
        if not best > SMALLEST:
            return 0
        pivot = row[p]
        if p != c:
            sign = -sign
            row[c], row[p] = pivot, row[c]
        if a[pivot, c] < 0.0:
            sign = -sign
        inverse = 1.0 / a[pivot, c]
        a[pivot, c] = inverse
        count = 0
        for k in range(c + 1, n):
            filled[pivot, count] = k
            count += a[pivot, k] != 0.0
        right[pivot] = count
        for i in range(rows):
            r = busy[i]
            if r != pivot:
                f = a[r, c] * inverse
                a[r, c] = f
                left[r] += 1
                filled[r, n - left[r]] = c
                for k in range(c + 1, n):
                    a[r, k] -= f * a[pivot, k]
    return sign


@inner
def solve_vector(system: Factors, b: Array) -> None:
    """Replace a right side, shape (n,), by the solution."""
    a, row, filled, left, right, _, x = system
    n = len(b)
    for i in range(n):
        r = row[i]
        total = b[r]
        for k in range(n - left[r], n):
            total -= a[r, filled[r, k]] * x[filled[r, k], 0]
        x[i, 0] = total
    for i in range(n - 1, -1, -1):
        r = row[i]
        total = x[i, 0]
        for k in range(right[r]):
            total -= a[r, filled[r, k]] * b[filled[r, k]]
        b[i] = total * a[r, i]


@inner
def solve_columns(system: Factors, b: Array) -> None:
    """Replace right sides, shape (n, k), by the solutions; k is a multiple of WIDTH."""
    a, row, filled, left, right, _, x = system
    n = len(a)
    for j in range(0, b.shape[1], WIDTH):
        for i in range(n):
            r = row[i]
            s, t, u = b[r, j], b[r, j + 1], b[r, j + 2]
            for k in range(n - left[r], n):
                c = filled[r, k]
                f = a[r, c]
                s, t, u = s - f * x[c, 0], t - f * x[c, 1], u - f * x[c, 2]
            x[i, 0], x[i, 1], x[i, 2] = s, t, u
        for i in range(n - 1, -1, -1):
            r = row[i]
            s, t, u = x[i, 0], x[i, 1], x[i, 2]
            for k in range(right[r]):
                c = filled[r, k]
                f = a[r, c]
                s, t, u = s - f * b[c, j], t - f * b[c, j + 1], u - f * b[c, j + 2]
            b[i, j], b[i, j + 1], b[i, j + 2] = s * a[r, i], t * a[r, i], u * a[r, i]
