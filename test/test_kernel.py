"""Kernels: plain IEEE arithmetic, functions as values."""

import numpy as np

from parallel_robot_base.function_value import FirstClass
from parallel_robot_base.kernel import kernel


@kernel
def twice(x):
    """2 x."""
    return 2.0 * x


@kernel
def square(x):
    """x^2."""
    return x * x


@kernel
def third(x):
    """Inexact, so that another order of evaluation would show."""
    return (x + 1e16) - 1e16 + x / 3.0


@kernel
def apply(function, x):
    """f(f(x))."""
    return function(function(x))


@kernel
def quotient(a, b):
    """a / b."""
    return a / b


def test_a_kernel_is_a_value_that_another_one_calls():
    doubled, squared = FirstClass(twice, 1.0), FirstClass(square, 1.0)
    assert apply(doubled, 3.0) == 12.0
    compiled = len(apply.signatures)
    assert apply(squared, 3.0) == 81.0
    assert len(apply.signatures) == compiled


def test_a_call_by_value_runs_the_same_code():
    by_value = FirstClass(third, 1.0)
    for x in np.random.default_rng(5).standard_normal(100):
        assert apply(by_value, x) == third(third(x)) == plain(plain(x))


def plain(x):
    return (x + 1e16) - 1e16 + x / 3.0


def test_first_class_needs_no_compiling_anew():
    FirstClass(twice, 1.0)
    before = len(twice.signatures)
    FirstClass(twice, 7.0)
    assert len(twice.signatures) == before


def test_division_by_zero_is_that_of_ieee_754():
    assert quotient(1.0, 0.0) == np.inf
    assert np.isnan(quotient(0.0, 0.0))
