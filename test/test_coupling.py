"""Synchronisation errors against the matrices of equations.md, section 4."""

import numpy as np
import pytest
from geometry import rows
from hypothesis import given
from hypothesis import strategies as st
from vectors import on_vectors

from parallel_robot_control import terms
from parallel_robot_model.common.ring import synchronisation_error

coupling, sig = on_vectors(terms.coupling), on_vectors(terms.sig)
ANY = st.integers(2, 8).flatmap(lambda n: rows(10.0, n))
L = np.array([[2, -1, -1], [-1, 2, -1], [-1, -1, 2]])


@given(rows(10.0))
def test_three_joints_are_coupled_by_the_matrix_of_the_paper(e):
    assert np.allclose(coupling(e), L @ e, atol=1e-14)
    assert np.allclose(synchronisation_error(e), [e[0] - e[1], e[1] - e[2], e[2] - e[0]])


@given(ANY)
def test_coupling_is_the_difference_of_synchronisation_errors(e):
    s = synchronisation_error(e)
    assert np.allclose(coupling(e), s - np.roll(s, 1), atol=1e-13)


@given(ANY)
def test_coupling_moves_no_mean_and_sees_no_common_error(e):
    assert abs(coupling(e).sum()) < 1e-12
    assert np.abs(coupling(np.full(len(e), e[0]))).max() < 1e-12


def test_synchronisation_errors_of_a_whole_run_are_those_of_its_rows():
    run = np.random.default_rng(3).standard_normal((20, 5))
    assert np.array_equal(synchronisation_error(run), [synchronisation_error(e) for e in run])


@given(ANY, st.floats(0.1, 2.0))
def test_sig_is_an_odd_power(x, exponent):
    expected = np.sign(x) * np.abs(x) ** exponent
    assert np.allclose(sig(x, exponent), expected, rtol=1e-14, atol=0)
    assert np.array_equal(sig(-x, exponent), -sig(x, exponent))


@pytest.mark.parametrize('exponent', [0.5, 0.67, 1.4])
def test_sig_of_no_error_is_nothing(exponent):
    assert not sig(np.zeros(3), exponent).any()
