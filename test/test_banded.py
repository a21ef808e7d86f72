"""Linear equations without LAPACK, against it."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.linalg import solve_banded

from parallel_robot_model.compiler import solve_full, solve_sparse
from trajectory_gen import spline


@pytest.mark.parametrize(('lower', 'upper'), [(0, 0), (1, 2), (3, 1), (4, 4)])
def test_a_band(lower, upper):
    rng, n = np.random.default_rng(1), 60
    matrix = np.tril(np.triu(rng.standard_normal((n, n)), -lower), upper)
    rows, columns = np.nonzero(matrix)
    right = rng.standard_normal((n, 2))
    band = np.zeros((lower + upper + 1, n))
    band[upper + rows - columns, columns] = matrix[rows, columns]
    found = solve_sparse(rows, columns, matrix[rows, columns], right)
    exact = solve_banded((lower, upper), band, right)
    scale = np.linalg.cond(matrix) * np.abs(exact).max()
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-14 * scale)


def test_a_full_matrix_whose_first_pivot_is_zero():
    matrix = np.array([[0.0, 2.0, 1.0], [1.0, -1.0, 0.0], [3.0, 0.5, 2.0]])
    right = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(solve_full(matrix, right), np.linalg.solve(matrix, right), 1e-12)


def test_a_singular_matrix_gives_nothing_finite():
    assert not np.isfinite(solve_full(np.ones((2, 2)), np.array([1.0, 2.0]))).any()


@pytest.mark.parametrize('count', [2, 3, 9])
def test_a_spline_from_a_motion_is_that_of_scipy(count):
    rng = np.random.default_rng(count)
    times = np.append(0.0, np.cumsum(rng.uniform(0.5, 2.0, count - 1)))
    points, rate, acceleration = rng.standard_normal((count, 2)), *rng.standard_normal((2, 2))
    zero = np.zeros(2)
    ends = [(1, rate), (2, acceleration)], [(1, zero), (2, zero)]
    exact = make_interp_spline(times, points, 5, bc_type=ends)
    found = spline.fit(times, points, False, 0.0, (rate, acceleration))
    np.testing.assert_allclose(found.c, exact.c, rtol=1e-12, atol=1e-12)


def test_a_periodic_spline_is_that_of_scipy():
    times = np.array([0.0, 0.7, 1.5, 2.1, 3.3, 4.0, 5.2, 6.0])
    points = np.sin(np.outer(times, [1.0, 2.0]) * np.pi / 3.0)
    points[-1] = points[0]
    t = np.linspace(0.0, 6.0, 101)
    exact = make_interp_spline(times, points, 5, bc_type='periodic')
    np.testing.assert_allclose(spline.fit(times, points, True, 0.0)(t), exact(t), 0.0, 1e-12)
