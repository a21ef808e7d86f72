"""Equations of motion against MuJoCo, closed forms, energies and finite differences."""

import mujoco
import numpy as np
import pytest
from geometry import ROBOT, legs
from mjcf_machines import MACHINES, POSE_3RRR, closure_row, made, samples, serial_2r
from test_serial_2r import ARM
from test_serial_2r import serial_2r as closed_form_2r
from vectors import OnVectors

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.dynamics import free_acceleration, model
from parallel_robot_model.mechanisms.mechanism import FOUND
from parallel_robot_model.robots import planar_3rrr

EVERY = pytest.mark.parametrize('name', MACHINES)


def model_at(boxed, q, velocity):
    """M, Q and gravity."""
    n = len(q)
    M, Q, gravity = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    assert close(*boxed, q) == FOUND
    model(*boxed, velocity, M, Q, gravity)
    return M, Q, gravity


def accelerated(boxed, velocity, torque):
    out = np.zeros_like(velocity)
    free_acceleration(*boxed, velocity, torque, out)
    return out


def states(machine, count, seed=0):
    """Positions and rates of the actuated joints."""
    velocity = np.random.default_rng(seed + 99).normal(size=(count, machine.n))
    return zip(samples(machine, count, seed), velocity, strict=True)


def test_arm_has_the_inertia_and_bias_of_mujoco():
    machine = made('arm')
    boxed, data = machine.boxed(), mujoco.MjData(machine.model)
    full = np.zeros((6, 6))
    for q, v in zip(*np.random.default_rng(5).uniform(-2, 2, (2, 30, 6)), strict=True):
        M, Q, gravity = model_at(boxed, q, v)
        data.qpos, data.qvel = q, v
        mujoco.mj_forward(machine.model, data)
        mujoco.mj_fullM(machine.model, data, full)
        np.testing.assert_allclose(M, full, rtol=0.0, atol=1e-13 * full.max())
        bias = data.qfrc_bias
        np.testing.assert_allclose(Q @ v + gravity, bias, atol=1e-12 * np.abs(bias).max())


@EVERY
def test_accelerations_are_those_of_mujocos_matrices(name):
    machine = made(name)
    m, w = boxed = machine.boxed()
    data, rng = mujoco.MjData(machine.model), np.random.default_rng(6)
    for q, v in states(machine, 8):
        torque = 10.0 * rng.normal(size=machine.n)
        M, Q, gravity = model_at(boxed, q, v)
        found = accelerated(boxed, v, torque)
        expected = constrained(machine, data, w.all, np.array(w.rate), torque)
        size = 1e-7 * max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(found, expected[m.actuated], atol=size, rtol=0.0)
        left = M @ found + Q @ v + gravity
        np.testing.assert_allclose(left, torque, atol=1e-11 * np.abs(M).max() * abs(found).max())


def constrained(machine, data, positions, rate, torque):
    """Accelerations of all joints: MuJoCo's inertia and bias, and multipliers."""
    m, engine = machine
    N, r, h = len(positions), len(m.closure), 1e-5

    def jacobian(q):
        data.qpos, data.qvel = q, rate
        mujoco.mj_forward(engine, data)
        return np.array([closure_row(m, engine, data, k) for k in range(r)]).reshape(r, N)

    J_rate = (jacobian(positions + h * rate) - jacobian(positions - h * rate)) / (2 * h)
    J, M = jacobian(positions), np.zeros((N, N))
    mujoco.mj_fullM(engine, data, M)
    force = -data.qfrc_bias
    force[m.actuated] += torque
    left = np.block([[M, J.T], [J, np.zeros((r, r))]])
    return np.linalg.solve(left, np.concatenate([force, -J_rate @ rate]))[:N]


@EVERY
def test_inertia_rate_minus_twice_coriolis_is_skew(name):
    machine = made(name)
    boxed, h = machine.boxed(), 3e-4
    for q, v in states(machine, 8):
        a, b, c, d = (model_at(boxed, q + s * h * v, v)[0] for s in (-2, -1, 1, 2))
        M, Q, _ = model_at(boxed, q, v)
        assert np.array_equal(M, M.T) and np.linalg.eigvalsh(M)[0] > 0.0
        skew = (8 * (c - b) - (d - a)) / (12 * h) - 2.0 * Q
        size = max(np.abs(Q).max(), np.abs(M).max())
        np.testing.assert_allclose(skew, -skew.T, rtol=0.0, atol=1e-8 * size)


@EVERY
def test_gravity_is_the_slope_of_the_potential(name):
    machine = made(name)
    m, w = boxed = machine.boxed()
    h = 1e-5
    for q, _ in states(machine, 4):
        gravity = model_at(boxed, q, 0.0 * q)[2]
        slope = np.zeros_like(q)
        for j in range(machine.n):
            for sign in (1.0, -1.0):
                assert close(m, w, q + sign * h * np.eye(machine.n)[j]) == FOUND
                slope[j] += sign * potential(m, w) / (2 * h)
        np.testing.assert_allclose(gravity, slope, atol=1e-7 * max(1.0, np.abs(slope).max()))


def potential(m, w):
    """Energy in the field of gravity [J]."""
    places = w.origin + np.einsum('iab,ib->ia', w.rotation, m.centre)
    return -float(m.mass @ places @ m.gravity)


@kernel
def swing(m, w, q: Array, v: Array, spring: Array, steps: int, dt: float, room: Array) -> int:
    """Move by Runge and Kutta's method; `spring` holds stiffness, rest and force at rest."""
    a, q_before, v_before, q_sum, v_sum, torque = room
    for _ in range(steps):
        q_before[:], v_before[:], q_sum[:], v_sum[:] = q, v, 0.0, 0.0
        for stage in range(4):
            if stage > 0:
                ahead = dt if stage == 3 else 0.5 * dt
                q[:], v[:] = q_before + ahead * v, v_before + ahead * a
            fault = close(m, w, q)
            if fault != FOUND:
                return fault
            torque[:] = spring[2] - spring[0] * (q - spring[1])
            free_acceleration(m, w, v, torque, a)
            share = dt / 6.0 if stage in (0, 3) else dt / 3.0
            q_sum += share * v
            v_sum += share * a
        q[:], v[:] = q_before + q_sum, v_before + v_sum
    return close(m, w, q)


@pytest.mark.parametrize('name', ['planar_3rrr', 'hexapod', 'five_bar', 'arm', 'coupled'])
def test_energy_is_kept_over_ten_seconds(name):
    machine = made(name)
    m, w = boxed = machine.boxed()
    q = m.home[m.actuated]
    v = np.random.default_rng(7).normal(size=machine.n) * m.length ** (m.turns[m.actuated] == 0.0)
    M, _, force = model_at(boxed, q, 0.0 * q)
    spring = np.array([60.0 * np.diag(M), q, force])

    def energy():
        M = model_at(boxed, q, v)[0]
        away = q - spring[1]
        return v @ M @ v / 2 + potential(m, w) + away @ (spring[0] * away / 2 - force)

    kinetic, before = v @ M @ v / 2, energy()
    assert swing(m, w, q, v, spring, 20_000, 5e-4, np.zeros((6, machine.n))) == FOUND
    assert abs(q - spring[1]).max() > 0.01 * m.length
    assert abs(energy() - before) <= 1e-9 * kinetic


def test_3rrr_has_its_closed_form():
    machine = made('planar_3rrr')
    boxed, rng = machine.boxed(), np.random.default_rng(8)
    estimate = OnVectors(planar_3rrr).estimate
    margins = planar_3rrr.SafetyMargins(0.0, 0.0)
    for _ in range(30):
        pose = POSE_3RRR + rng.uniform(-0.06, 0.06, 3)
        theta, velocity = legs(ROBOT, pose)[0], rng.normal(size=3)
        M, Q, gravity = model_at(boxed, theta, velocity)
        known = estimate(ROBOT, margins, theta, velocity, pose).model
        np.testing.assert_allclose(M, known.M, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(Q @ velocity, known.Q @ velocity, rtol=0.0, atol=1e-11)
        assert not gravity.any()


def test_serial_arm_has_its_closed_form():
    arm = ARM._replace(mp=0.0)
    boxed, rng = serial_2r(arm).boxed(), np.random.default_rng(9)
    for _ in range(20):
        q, velocity = np.array([0.0, 1.2]) + rng.uniform(-1, 1, 2), rng.normal(size=2)
        M, Q, gravity = model_at(boxed, q, velocity)
        margins = closed_form_2r.SafetyMargins(0.0)
        known = closed_form_2r.estimate(arm, margins, q, velocity, np.zeros(2)).model
        np.testing.assert_allclose(M, known.M, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(Q @ velocity, known.Q @ velocity, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(gravity, known.gravity, rtol=0.0, atol=1e-13)
