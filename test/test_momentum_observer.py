"""The momentum observer against closed forms, and against robots under a known external torque."""

import numpy as np
import pytest
from assembly import simulate
from scipy.integrate import solve_ivp
from vectors import OnVectors

from parallel_robot_control.estimation.estimator import Observed, observed
from parallel_robot_model.compiler import as_vectors, kernel
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.contract import Model

K = 20.0  # 1/s
T = 1e-3  # s


@kernel
def _step(bandwidth, before, known, model, velocity, torque, dt):
    return observed(bandwidth, before, known, model, velocity, torque, dt)


def residuals(models, velocity, torque, dts, bandwidth=K):
    """Residual at each state; `torque[k]` acts from state k to k + 1, for `dts[k]`."""
    zero = np.zeros(velocity.shape[1])
    before, found = Observed(*as_vectors((zero, zero, zero))), []
    for k, model in enumerate(models):
        acted, dt = (torque[k - 1], dts[k - 1]) if k else (zero, 1.0)
        words = as_vectors((before, k > 0, Model(*model), velocity[k], acted, dt))
        before = _step(bandwidth, *words)
        found.append(np.array(before.residual))
    return np.array(found)


@pytest.mark.parametrize('bandwidth', [1.0, 20.0, 300.0])
def test_a_constant_torque_is_found_with_the_bandwidth_at_whatever_samples(bandwidth):
    """r = tau_ext (1 - exp(-K t)), exactly, for a constant inertia."""
    random = np.random.default_rng(1)
    M = np.array([[1.5, -0.3], [-0.3, 0.9]])
    gravity, external = np.array([2.0, -1.0]), np.array([0.7, -4.0])
    dts = random.uniform(0.5e-3, 20e-3, 400)
    torque = random.normal(0.0, 10.0, (400, 2))
    steps = dts[:, np.newaxis] * np.linalg.solve(M, (torque - gravity + external).T).T
    velocity = np.concatenate([[[3.0, -2.0]], steps]).cumsum(axis=0)
    models = [(M, np.zeros((2, 2)), gravity)] * 401
    found = residuals(models, velocity, torque, dts, bandwidth)
    time = np.concatenate([[0.0], dts]).cumsum()[:, np.newaxis]
    np.testing.assert_allclose(found, external * (1.0 - np.exp(-bandwidth * time)), atol=1e-9)


def arm(q, v):
    """A textbook arm of two links in a vertical plane: M, C by Christoffel symbols, g."""
    a, b, d = 1.8, 0.6, 0.5
    c, h = b * np.cos(q[1]), -b * np.sin(q[1])
    M = np.array([[a + 2.0 * c, d + c], [d + c, d]])
    C = np.array([[h * v[1], h * (v[0] + v[1])], [-h * v[0], 0.0]])
    g = 9.81 * np.array([2.0 * np.cos(q[0]) + 0.7 * np.cos(q.sum()), 0.7 * np.cos(q.sum())])
    return M, C, g


def test_a_torque_that_changes_is_followed_while_the_arm_moves_fast():
    """r follows r' = K (tau_ext - r), at speeds at which C^T qd is as large as the torque."""
    random, count = np.random.default_rng(2), 1500

    def external(t):
        return np.array([3.0 * np.sin(4.0 * t), 2.0 * np.cos(7.0 * t)])

    def slope(t, x, tau):
        M, C, g = arm(x[:2], x[2:4])
        acceleration = np.linalg.solve(M, tau + external(t) - C @ x[2:4] - g)
        return np.concatenate([x[2:4], acceleration, K * (external(t) - x[4:])])

    x, rows, torques = np.array([0.3, 0.8, 4.0, -6.0, 0.0, 0.0]), [], []
    for k in range(count):
        _, C, g = arm(x[:2], x[2:4])
        torques.append(g + C @ x[2:4] + random.normal(0.0, 5.0, 2) - 2.0 * (x[2:4] - [4.0, -6.0]))
        rows.append(x)
        x = solve_ivp(slope, (k * T, (k + 1) * T), x, args=(torques[-1],), rtol=1e-9).y[:, -1]
    states = np.array(rows)
    models = [arm(row[:2], row[2:4]) for row in states]
    drift = [C.T @ row[2:4] for (_, C, _), row in zip(models, states, strict=True)]
    assert np.abs(drift).max() > 3.0  # N m: it matters
    found = residuals(models, states[:, 2:4], torques, [T] * count)
    np.testing.assert_allclose(found, states[:, 4:], atol=0.02)


def test_friction_and_disturbance_of_the_parallel_robot_are_the_residual(robot, values):
    constant, viscous, coulomb = np.array([2.0, -1.0, 0.5]), 2.5, 0.5
    out = simulate('excitation', 3.0, {'disturbance.constant': constant.tolist()}).out
    margins = group(values, planar_3rrr.SafetyMargins, 'safety')
    module = OnVectors(planar_3rrr)
    found = [
        module.estimate(robot, margins, *row)
        for row in zip(out.position, out.velocity, out.pose, strict=True)
    ]
    assert not any(one.fault for one in found)
    models = [tuple(map(np.array, one.model)) for one in found]
    got = residuals(models, out.velocity, out.command, [T] * len(models))
    external = -viscous * out.velocity - coulomb * np.sign(out.velocity) - constant
    kept, wanted = np.exp(-K * T), [np.zeros(3)]
    for mean in 0.5 * (external[1:] + external[:-1]):
        wanted.append(kept * wanted[-1] + (1.0 - kept) * mean)
    assert np.abs(wanted).max() > 5.0
    np.testing.assert_allclose(got, wanted, atol=0.1)
