"""Splines of degree 5 through or near points, from rest to rest or periodic."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import solve_sparse

DEGREE = 5  # of a motion of least mean square jerk between points
ENDS = 3  # coefficients at each end that position, zero rate and zero acceleration fix


def fit(
    times: Array,
    points: Array,
    periodic: bool,
    smoothing: float,
    start: tuple[Array, Array] | None = None,
) -> BSpline:
    """The spline f that minimises integral |f - p|^2 + smoothing^6 integral |f'''|^2.

    The first integral is a sum over the points, each with its share of the time; without
    smoothing, f passes through all of them. Points that lie densely are filtered without delay by
    1 / (1 + (smoothing w)^6). The jerk alone is least for a spline of degree 5 whose knots are the
    points, and whose third and fourth derivatives are continuous, too.

    Args:
        times: Times of the points [s], increasing, shape (N,).
        points: The points p, shape (N, m); if periodic, the last equals the first.
        periodic: Whether f repeats itself; else it is at rest at both ends, in the end points.
        smoothing: Time constant [s].
        start: Rate and acceleration of the first point, where it is not at rest.

    Source:
        Flash, Hogan (1985), The coordination of arm movements, J. Neuroscience 5(7), for least
        jerk through points; Green, Silverman (1994), Nonparametric Regression and Generalized
        Linear Models, chapter 2, for the smoothing.
    """
    length, steps = times[-1] - times[0], np.diff(times)
    count = len(times) - 1
    # 1. Knots, and the coefficients c = F z + g that the ends leave free.
    if periodic:
        laps = np.arange(-DEGREE, count + DEGREE + 1)
        knots = times[laps % count] + laps // count * length
        free = sparse.csr_array(
            (np.ones(count + DEGREE), (np.arange(count + DEGREE), laps[: count + DEGREE] % count))
        )
        fixed = np.zeros((count + DEGREE, points.shape[1]))
        inner, share = slice(0, count), 0.5 * (steps + np.roll(steps, 1))
    else:
        knots = np.concatenate([times[:1].repeat(DEGREE), times, times[-1:].repeat(DEGREE)])
        free = sparse.eye(count + DEGREE, format='csr')[:, ENDS:-ENDS]
        fixed = np.zeros((count + DEGREE, points.shape[1]))
        fixed[:ENDS], fixed[-ENDS:] = points[0], points[-1]
        if start:  # coefficients of the first derivative are rate and change
            change = start[0] + start[1] * steps[0] / (DEGREE - 1)
            fixed[1] += start[0] * steps[0] / DEGREE
            fixed[2] = fixed[1] + change * (knots[DEGREE + 2] - knots[2]) / DEGREE
        inner, share = slice(1, count), 0.5 * (steps[1:] + steps[:-1])
    if not free.shape[1]:  # two points: the ends say all
        return BSpline(knots, fixed, DEGREE)
    # 2. Values at the points, B c = p, and with smoothing the jerk, too.
    values = BSpline.design_matrix(times[inner], knots, DEGREE)
    matrix, right = values @ free, points[inner] - values @ fixed
    if smoothing:
        cubed = smoothing * smoothing * smoothing
        jerk = _jerk(knots, times)
        weight = sparse.diags(share)
        right = matrix.T @ (weight @ right) - cubed * cubed * (free.T @ (jerk.T @ (jerk @ fixed)))
        rough = jerk @ free
        matrix = matrix.T @ weight @ matrix + cubed * cubed * (rough.T @ rough)
    return BSpline(knots, free @ _solved(matrix, right, periodic) + fixed, DEGREE)


def polynomials(spline: BSpline, times: Array) -> Array:
    """Coefficients of the powers 5 to 0 of the time since each but the last, shape (K, 6, m)."""
    powers = range(DEGREE, -1, -1)
    return np.stack([spline(times[:-1], nu=k) / math.factorial(k) for k in powers], axis=1)


def _solved(matrix: Any, right: Array, periodic: bool) -> Array:
    """Solution of sparse equations, the same bits on every processor; NaN if there is none.

    The unknowns of a periodic motion are neighbours across its end, too: taken from both ends in
    turn, they lie near the diagonal.
    """
    n = len(right)
    order = np.arange(n)
    if periodic:
        order = np.stack([order, order[::-1]], axis=1).ravel()[:n]
    place = np.argsort(order)
    found = sparse.coo_array(matrix)
    found.sum_duplicates()
    solved = solve_sparse(place[found.row], place[found.col], found.data, right[order])
    return solved[place]


def _jerk(knots: Array, times: Array) -> Any:
    """Matrix of the coefficients: squares of its product sum to the integral of the jerk's."""
    derivative: Any = sparse.eye(len(knots) - DEGREE - 1, format='csr')
    for degree in range(DEGREE, DEGREE - 3, -1):  # coefficients of the next derivative
        cut = DEGREE - degree
        inner = knots[cut : len(knots) - cut]
        rows = len(inner) - degree - 2
        slope = degree / (inner[degree + 1 : degree + 1 + rows] - inner[1 : 1 + rows])
        step = sparse.diags([-slope, slope], offsets=[0, 1], shape=(rows, rows + 1))
        derivative = step @ derivative
    # Gauss and Legendre with three nodes: exact for a square of degree 4.
    nodes = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
    weights = np.array([5.0, 8.0, 5.0]) / 9.0
    steps = np.diff(times)[:, np.newaxis]
    places = (times[:-1, np.newaxis] + 0.5 * steps * (1.0 + nodes)).ravel()
    basis = BSpline.design_matrix(places, knots[3:-3], DEGREE - 3)
    return sparse.diags(np.sqrt((0.5 * steps * weights).ravel())) @ basis @ derivative
