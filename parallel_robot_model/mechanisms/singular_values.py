"""The smallest singular value of a small matrix, from the eigenvalues of its Gram matrix."""

from __future__ import annotations

import math

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner

ITERATIONS = 20  # four are usual
ENOUGH = 1e-3  # relative step, the cube of which is the error that is left


@inner
def evenness(gram: Array, tridiagonal: Array) -> float:
    """The smallest singular value over the root mean square of all: 1 if they are equal.

    Args:
        gram: A^T A, shape (k, k), of which the lower triangle is read, and overwritten.
        tridiagonal: Room for four vectors, shape (4, k) or larger.

    Returns:
        A number from 0 to 1, with an error of some 1e-8.
    """
    k, total = len(gram), trace(gram)
    if not total > 0.0:
        return 0.0
    _make_tridiagonal(gram, tridiagonal)
    smallest = _smallest_eigenvalue(tridiagonal, k, 1e-16 * total)
    return math.sqrt(min(1.0, max(0.0, k * smallest / total)))


@inner
def is_as_even(gram: Array, share: float) -> bool:
    """Whether `evenness` is at least a share above 0, in a third of its time.

    It is if A^T A, less a multiple of the identity, has only positive pivots.

    Args:
        gram: A^T A, shape (k, k), of which the lower triangle is read, and overwritten.
        share: The share; where it is 0 or less, only numbers are asked for.
    """
    k, total = len(gram), trace(gram)
    if share <= 0.0:
        return total >= 0.0
    less = share * share * total / k
    for c in range(k - 1, -1, -1):
        pivot = gram[c, c] - less
        if not pivot > 0.0:
            return False
        for i in range(c):
            if gram[c, i] != 0.0:
                f = gram[c, i] / pivot
                for j in range(i + 1):
                    gram[i, j] -= f * gram[c, j]
    return True


@inner
def trace(a: Array) -> float:
    """Sum of the elements of the diagonal."""
    total = 0.0
    for i in range(len(a)):
        total += a[i, i]
    return total


@inner
def _make_tridiagonal(a: Array, out: Array) -> None:
    """Householder's reflections: the diagonal to row 0, squares of that beside it to row 1.

    Source:
        Golub, Van Loan (2013), Matrix Computations, algorithm 8.3.1.
    """
    n, u, p = len(a), out[2], out[3]
    for c in range(n - 1):
        square = 0.0
        for i in range(c + 2, n):
            square += a[i, c] * a[i, c]
        first = a[c + 1, c]
        whole = square + first * first
        out[0, c], out[1, c] = a[c, c], whole
        if square == 0.0:
            continue
        for i in range(c + 1, n):
            u[i], p[i] = a[i, c], 0.0
        u[c + 1] = first + math.copysign(math.sqrt(whole), first)
        b = 2.0 / (square + u[c + 1] * u[c + 1])
        along = _times_lower(a, u, p, c + 1)
        for i in range(c + 1, n):
            p[i] = b * (p[i] - 0.5 * b * along * u[i])
        for i in range(c + 1, n):
            s, t = u[i], p[i]
            for k in range(c + 1, i + 1):
                a[i, k] -= s * p[k] + t * u[k]
    out[0, n - 1] = a[n - 1, n - 1]


@inner
def _times_lower(a: Array, u: Array, p: Array, start: int) -> float:
    """Add the symmetric matrix times u to p, both from an index on.

    Returns:
        u a u.
    """
    along = 0.0
    for i in range(start, len(a)):
        total, own = 0.0, u[i]
        for k in range(start, i):
            total += a[i, k] * u[k]
            p[k] += a[i, k] * own
        p[i] += total + a[i, i] * own
        along += own * (2.0 * total + a[i, i] * own)
    return along


@inner
def _smallest_eigenvalue(tridiagonal: Array, n: int, noise: float) -> float:
    """Smallest eigenvalue of a positive matrix: Laguerre's iteration from zero, from below.

    Source:
        Li, Zeng (1994), The Laguerre iteration in solving the symmetric tridiagonal eigenproblem,
        revisited, SIAM J. Sci. Comput. 15(5).
    """
    x = 0.0
    for _ in range(ITERATIONS):
        # pivots q of the factored matrix, u = -q' and v = u': sums of 1 / (eigenvalue - x)
        q, u, v = 1.0, 0.0, 0.0
        first, second = 0.0, 0.0
        for i in range(n):
            over = tridiagonal[1, i - 1] / q if i > 0 else 0.0
            ratio = u / q
            v = over * (2.0 * ratio * ratio + v / q)
            u = 1.0 + over * ratio
            q = tridiagonal[0, i] - x - over
            if not q > noise:
                return x
            part = u / q
            first += part
            second += part * part + v / q
        spread = max(0.0, (n - 1) * (n * second - first * first))
        step = n / (first + math.sqrt(spread))
        x += step
        if not step > ENOUGH * x:
            return x
    return x
