"""Products of small vectors and matrices in kernels, summed in order: the same bits everywhere."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler.kernels import internal, kernel
from parallel_robot_model.compiler.vectors import VectorType, elementwise, on_vectors, vector


@kernel
def dot(a: Array, b: Array) -> float:
    """Scalar product of two vectors of shape (n,)."""
    return np.sum(a * b)


@kernel
def cross(a: Array, b: Array) -> Array:
    """Vector product of two vectors of shape (3,)."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return vector((x, y, z))


@kernel
def multiply(a: Array, x: Array) -> Array:
    """Product of a matrix (n, n) and a vector (n,); both vectors of kernels, or both arrays."""
    return _product(a, x)


def _product(a: Any, x: Any) -> Any:
    return a @ x


@overload(_product, strict=False)
def _product_of(a: Any, x: Any) -> Any:
    if not isinstance(a, types.Array):
        return lambda a, x: a @ x

    def of_arrays(a: Any, x: Any) -> Any:
        y = np.empty(len(x))
        for i in range(len(x)):
            total = 0.0
            for j in range(len(x)):
                total += a[i, j] * x[j]
            y[i] = total
        return y

    return of_arrays


@kernel
def solve(a: Array, b: Array) -> Array:
    """Solution x of a x = b by Cholesky, a = L D L^T; shapes (n, n) and (n,).

    `a` is symmetric and positive definite; otherwise x may be not finite. Only its lower triangle
    is read.
    """
    return _solution(a, b)


def _solution(a: Any, b: Any) -> Any:
    n = len(b)
    return _solved(a, b, np.empty((n, n)), np.empty(n), np.empty(n)).view(type(b))


@internal
def _solved(a: Any, b: Any, lower: Any, diagonal: Any, x: Any) -> Any:
    """The solution, written to x; `lower` and `diagonal` are room for the factors."""
    n = len(b)
    for i in range(n):
        total = a[i, i]
        for j in range(i):
            part = a[i, j]
            for k in range(j):
                part -= lower[i, k] * diagonal[k] * lower[j, k]
            lower[i, j] = part / diagonal[j]
            total -= lower[i, j] * part
        diagonal[i] = total
    for i in range(n):
        x[i] = b[i]
        for j in range(i):
            x[i] -= lower[i, j] * x[j]
    for i in range(n - 1, -1, -1):
        x[i] /= diagonal[i]
        for j in range(i + 1, n):
            x[i] -= lower[j, i] * x[j]
    return x


@overload(_solution, strict=False)
def _solution_of_arrays(a: Any, b: Any) -> Any:
    def solution(a: Any, b: Any) -> Any:
        n = len(b)
        return _solved(a, b, np.empty((n, n)), np.empty(n), np.empty(n))

    return solution if isinstance(a, types.Array) else None


@on_vectors(_solution, (VectorType, VectorType))
def _solution_of_vectors(context: Any, a: Any, b: Any) -> Any:
    """The same, unrolled."""
    solved: Any = _solved
    room = np.empty((b.count + 2, b.count), object)
    element = elementwise(context, operator.mul, (a.element.element, b.element))
    return VectorType(b.count, element), lambda a, b: solved.py_func(
        a, b, room[2:], room[0], room[1]
    )


# Linear equations with a matrix that is zero far from its diagonal.

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
