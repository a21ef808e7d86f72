"""S-FOTSMC against whole-run array formulas written straight from equations.md."""

import numpy as np
import pytest
from vectors import on_vectors

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.terms import advanced
from parallel_robot_model.compiler import as_arrays
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.contract import Model

update = on_vectors(s_fotsmc.update)
GAINS = group(config.resolve('paper_circle'), s_fotsmc.Gains, 's_fotsmc')


def ring(n):
    """L of equations.md, section 4, for n joints."""
    one = np.eye(n)
    return 2 * one - np.roll(one, 1, axis=0) - np.roll(one, -1, axis=0)


def sig(x, exponent):
    return np.abs(x) ** exponent * np.sign(x)


def before(samples, dt):
    """Integral up to each sample by forward Euler."""
    return dt * (np.cumsum(samples, axis=0) - samples)


def expected(gains, reference, feedback, M, Q, dt):
    """Torque and S of a whole run, each shape (N, n)."""
    theta_d, rate_d, acceleration_d = reference
    theta, rate = feedback
    e, e_dot = theta_d - theta, rate_d - rate
    L = ring(e.shape[1])
    e_c = e + gains.lambda_ * before(e @ L, dt)
    e_c_dot = e_dot + gains.lambda_ * e @ L
    w = gains.Gamma2 * sig(e_c_dot, gains.gamma2) + gains.Gamma1 * sig(e_c, gains.gamma1)
    v = e_c_dot + before(w, dt)
    S = np.diff(v, axis=0, prepend=v[:1]) / dt
    tau_sw = before((gains.G + gains.g) * np.sign(S), dt)
    coriolis = np.linalg.solve(M, np.einsum('kij,kj->ki', Q, rate)[..., None])[..., 0]
    tau_eq = acceleration_d + coriolis + gains.lambda_ * e_dot @ L + w
    return np.einsum('kij,kj->ki', M, tau_eq + tau_sw), S


def play(gains, reference, feedback, M, Q, dt):
    """Torque, S and memory of the law, sample by sample."""
    memory = s_fotsmc.initial_memory(reference.shape[2])
    torques, sliding = [], []
    for k in range(reference.shape[1]):
        out = update(
            gains, Model(M[k], Q[k], np.zeros(len(M[k]))), JointReference(*reference[:, k]),
            Feedback(*feedback[:, k], *np.zeros((2, reference.shape[2]))), memory, dt,
        )  # fmt: skip
        memory = out.memory
        torques.append(out.torque)
        sliding.append(out.sliding_variable)
    return np.array(torques), np.array(sliding), memory


def random_run(n, count=200, seed=0):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((count, n, n))
    M = root @ root.transpose(0, 2, 1) + np.eye(n)
    return (
        rng.standard_normal((3, count, n)),
        rng.standard_normal((2, count, n)),
        M,
        rng.standard_normal((count, n, n)),
    )


@pytest.mark.parametrize('n', [2, 3, 4, 5])
@pytest.mark.parametrize('changes', [{}, {'lambda_': 0.0}, {'gamma1': 0.9, 'G': 2.0, 'g': 0.5}])
def test_torque_and_surface_of_a_random_run(n, changes):
    gains, data = GAINS._replace(**changes), random_run(n, seed=n)
    torque, sliding, _ = play(gains, *data, 1e-2)
    torque_expected, sliding_expected = expected(gains, *data, 1e-2)
    assert np.allclose(torque, torque_expected, rtol=1e-9, atol=1e-9)
    assert np.allclose(sliding, sliding_expected, rtol=1e-9, atol=1e-9)


def test_surface_is_the_full_order_one_of_the_paper():
    """S of smooth errors e = a cos(w t + p) from their exact derivatives and integral."""
    dt, count = 1e-4, 5000
    t = np.arange(count)[:, None] * dt
    a, w, p = np.array([0.3, 0.2, 0.4]), np.array([1.0, 2.0, 1.5]), np.array([0.1, 0.5, 1.0])
    e = a * np.cos(w * t + p)
    e_dot, e_ddot = -a * w * np.sin(w * t + p), -(w**2) * e
    integral = a / w * (np.sin(w * t + p) - np.sin(p))
    lambda_L = GAINS.lambda_ * ring(3)
    e_c, e_c_dot, e_c_ddot = (
        x + y @ lambda_L for x, y in ((e, integral), (e_dot, e), (e_ddot, e_dot))
    )
    S = e_c_ddot + GAINS.Gamma2 * sig(e_c_dot, GAINS.gamma2) + GAINS.Gamma1 * sig(e_c, 0.5)
    still, eye = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    reference, feedback = np.stack([e, e_dot, still]), np.stack([still, still])
    found = play(GAINS, reference, feedback, eye, 0 * eye, dt)[1]
    error = np.abs(found[1:] - S[:-1])  # largest where sig has its vertical tangent
    assert error.mean() < 1e-3 and error.max() < 0.1 and np.abs(S).max() > 10
    clear = np.abs(S[:-1]) > 0.1
    assert np.array_equal(np.sign(found[1:])[clear], np.sign(S[:-1])[clear])


def test_switching_integrates_the_sign_of_the_step_of_v():
    """With Gamma = 0 and lambda = 0, v is e' alone: its steps are the only thing that counts."""
    gains = GAINS._replace(lambda_=0.0, Gamma1=0.0, Gamma2=0.0)
    rates = np.array([5.0, 6.0, 6.5, 6.5, 2.0, 1.0, -1.0, 0.0])
    steps = [0, 1, 1, 0, -1, -1, -1, 1]  # the first sample has none before it
    reference = np.zeros((3, 8, 2))
    reference[1] = rates[:, None] * [1.0, -1.0]
    eye = np.tile(np.eye(2), (8, 1, 1))
    torque, _, memory = play(gains, reference, np.zeros((2, 8, 2)), eye, 0 * eye, 0.1)
    switched = 0.1 * 10.01 * np.concatenate([[0], np.cumsum(steps)])[:, None] * [1.0, -1.0]
    assert np.allclose(torque, switched[:-1], atol=1e-12)
    assert np.allclose(on_vectors(advanced)(memory.switching, 0.1), switched[-1], atol=1e-12)


def test_no_error_needs_only_the_torque_of_the_motion():
    reference, _, M, Q = random_run(3, count=20)
    torque, sliding, memory = play(GAINS, reference, reference[:2], M, Q, 1e-3)
    motion = np.einsum('kij,kj->ki', M, reference[2]) + np.einsum('kij,kj->ki', Q, reference[1])
    assert np.allclose(torque, motion, rtol=1e-12, atol=1e-12)
    assert not sliding.any() and not memory.switching.rate.any()


def test_torque_drives_the_error_down():
    """A double integrator under the law comes to rest at its reference."""
    memory, theta, rate = s_fotsmc.initial_memory(3), np.array([0.02, -0.01, 0.015]), np.zeros(3)
    model, desired = (
        Model(np.eye(3), np.zeros((3, 3)), np.zeros(3)),
        JointReference(*np.zeros((3, 3))),
    )
    for _ in range(8000):
        feedback = Feedback(theta, rate, *np.zeros((2, 3)))
        out = update(GAINS, model, desired, feedback, memory, 1e-3)
        memory, rate = out.memory, rate + 1e-3 * out.torque
        theta = theta + 1e-3 * rate
    assert np.abs(theta).max() < 1e-5


def test_with_arrays_an_update_has_the_same_bits_and_changes_nothing_that_it_was_given():
    reference, feedback, M, Q = random_run(3, count=2)
    memory = as_arrays(s_fotsmc.initial_memory(3)._replace(started=1.0))
    feedback = Feedback(*feedback[:, 0], np.array([1.0, -1.0, 0.0]), np.zeros(3))
    given = (Model(M[0], Q[0], np.zeros(3)), JointReference(*reference[:, 0]), feedback)
    copies = [[np.copy(field) for field in part] for part in given]
    out = s_fotsmc.update(GAINS, *given, memory, 1e-3)
    assert type(out.torque) is np.ndarray
    for part, copy in zip(given, copies, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(part, copy, strict=True))
    assert not np.any(memory.v) and not any(np.any(integral) for integral in memory[:3])
    expected = update(GAINS, *given, memory, 1e-3)
    assert np.array_equal(out.torque, expected.torque)
    assert np.array_equal(out.sliding_variable, expected.sliding_variable)
