"""Integrators against closed forms; their orders by step halving."""

import math

import numpy as np
import pytest
from vectors import on_vectors

from parallel_robot_model.compiler import kernel
from parallel_robot_sim.plant import ode3, rk4

ORDERS = pytest.mark.parametrize(('step', 'order'), [(ode3, 3), (rk4, 4)])


@kernel
def spring(q, v, t, stiffness):
    """q'' = -stiffness q."""
    return -stiffness * q


@kernel
def drag(q, v, t, rate):
    """q'' = -rate v."""
    return -rate * v


@kernel
def push(q, v, t, degree):
    """q'' = t^degree; vectors of one size in, one out."""
    return 0.0 * q + t**degree


@kernel
def driven(q, v, t, _):
    """q'' = -q - 2 v + exp(-t) cos t, of coordinates, rate and time at once."""
    return math.exp(-t) * math.cos(t) - q - 2.0 * v


def advance(step, acceleration, q, v, h, steps, arguments, t=0.0):
    for k in range(steps):
        q, v = on_vectors(step)(acceleration, q, v, t + k * h, h, arguments)
    return q, v


def exact(t):
    """Solution of :func:`driven` from q = (0, 2), v = (1, -1).

    With q = exp(-t) u it is u'' = cos t, so u = u(0) + 1 + (v(0) + u(0)) t - cos t.
    """
    begin, rate = np.array([0.0, 2.0]), np.array([1.0, -1.0])
    u = begin + 1.0 + (rate + begin) * t - math.cos(t)
    return math.exp(-t) * u, math.exp(-t) * (rate + begin + math.sin(t) - u)


@ORDERS
def test_order_by_step_halving(step, order):
    q, v = np.array([0.0, 2.0]), np.array([1.0, -1.0])
    errors = []
    for steps in (20, 40, 80, 160):
        found = advance(step, driven, q, v, 2.0 / steps, steps, 0.0)
        errors.append(np.abs(np.subtract(found, exact(2.0))).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert abs(orders[-1] - order) < 0.1
    assert errors[0] < 1e-4


@ORDERS
def test_an_oscillator_is_that_of_the_closed_form(step, order):
    w = 3.0
    q, v = np.array([0.3, 0.0, -0.1]), np.array([0.0, 0.6, 0.9])
    found = advance(step, spring, q, v, 1e-3, 2000, w * w)
    c, s = math.cos(2.0 * w), math.sin(2.0 * w)
    assert np.allclose(found[0], q * c + v / w * s, rtol=0, atol=1e-7 if order == 3 else 1e-10)
    assert np.allclose(found[1], v * c - q * w * s, rtol=0, atol=1e-6 if order == 3 else 1e-9)


@ORDERS
def test_one_step_is_the_taylor_polynomial_of_its_order(step, order):
    """Of v' = -rate v, and of the oscillator as q + i v: both components of one step."""
    one = np.ones(2)
    for z in (0.3, -0.7):
        taylor = sum(z**k / math.factorial(k) for k in range(order + 1))
        assert np.allclose(advance(step, drag, one, one, 0.1, 1, -10 * z)[1], taylor, rtol=1e-14)
        q, v = advance(step, spring, one, 0.0 * one, z, 1, 1.0)
        turned = sum((-1j * z) ** k / math.factorial(k) for k in range(order + 1))
        assert np.allclose(q + 1j * v, turned, rtol=1e-14)


@ORDERS
@pytest.mark.parametrize('start', [0.0, 1.5])
def test_a_force_that_depends_on_time_acts_at_the_times_of_the_stages(step, order, start):
    """v is exact for t^(order - 1), which needs every stage at its own time."""
    begin, h, degree = np.array([0.2]), 0.4, order - 1
    _, v = advance(step, push, begin, begin, h, 1, degree, start)
    gained = ((start + h) ** order - start**order) / order
    assert np.allclose(v - begin, gained, rtol=1e-14)
    _, v = advance(step, push, begin, begin, h, 1, order, start)
    gained = ((start + h) ** (order + 1) - start ** (order + 1)) / (order + 1)
    assert np.abs(v - begin - gained).max() > 1e-5
