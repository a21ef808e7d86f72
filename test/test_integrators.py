"""Integrators against closed forms; their orders by step halving."""

import math

import numpy as np
import pytest

from parallel_robot_base.kernel import kernel
from parallel_robot_sim.integrators import ode3, rk4


@kernel
def growth(y, rate):
    """y' = rate y."""
    return rate * y


@kernel
def logistic(y, _):
    """Time t' = 1 and x' = t x (1 - x): x = 1 / (1 + exp(-t^2 / 2)) from x(0) = 1/2."""
    return np.array([1.0, y[0] * y[1] * (1.0 - y[1])])


def logistic_error(step, h):
    y = np.array([0.0, 0.5])
    for _ in range(round(2.0 / h)):
        y = step(logistic, y, h, 0.0)
    return abs(y[1] - 1.0 / (1.0 + math.exp(-2.0)))


@pytest.mark.parametrize(('step', 'order'), [(ode3, 3), (rk4, 4)])
def test_order_by_step_halving(step, order):
    errors = [logistic_error(step, h) for h in (0.1, 0.05, 0.025, 0.0125)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert abs(orders[-1] - order) < 0.1
    assert errors[0] < 1e-4


@pytest.mark.parametrize(('step', 'order'), [(ode3, 3), (rk4, 4)])
def test_one_step_is_the_taylor_polynomial_of_its_order(step, order):
    for z in (0.3, -0.7):
        taylor = sum(z**k / math.factorial(k) for k in range(order + 1))
        assert np.allclose(step(growth, np.ones(2), 0.1, 10 * z), taylor, rtol=1e-14)
