"""Symmetric, positive definite systems, in place."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner


@inner
def solve_symmetric(a: Array, b: Array) -> None:
    """Replace b, shape (n,), by the solution of a x = b; a, shape (n, n), becomes its L D L^T.

    Only the lower triangle of `a` is read.
    """
    n = len(b)
    for i in range(n):
        for j in range(i):
            part = a[i, j]
            for k in range(j):
                part -= a[i, k] * a[j, k] * a[k, k]
            a[i, j] = part / a[j, j]
        for k in range(i):
            a[i, i] -= a[i, k] * a[i, k] * a[k, k]
            b[i] -= a[i, k] * b[k]
    for i in range(n - 1, -1, -1):
        b[i] /= a[i, i]
        for j in range(i + 1, n):
            b[i] -= a[j, i] * b[j]
