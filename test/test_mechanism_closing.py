"""Postures of machines with loops: closed, on their branch, the same whatever way leads there."""

import numpy as np
import pytest
from mjcf_machines import MACHINES, closure_row, made, mujoco, samples

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.mechanisms.closure_solver import close, close_coarsely
from parallel_robot_model.mechanisms.closures import all_accelerations, joint_rates
from parallel_robot_model.mechanisms.mechanism import (
    COUPLING,
    FOUND,
    NOT_CLOSED,
    NOT_FINITE,
    SINGULAR,
)
from parallel_robot_model.mechanisms.skeleton import frames, postures
from parallel_robot_model.mechanisms.workspace import reset_to_home, workspace

LOOPS = [name for name in MACHINES if name not in ('arm', 'wrist', 'universal')]


def open_by(machine, positions):
    """Largest distance of the points that a closure joins, and angle between its frames."""
    m, model = machine
    data = mujoco.MjData(model)
    data.qpos = positions
    mujoco.mj_forward(model, data)
    worst = 0.0
    for k in range(len(m.closure)):
        if m.closure[k] == COUPLING:
            a, b = positions[m.first[k]], positions[m.second[k]]
            worst = max(worst, abs(a - m.offset[k] - m.ratio[k] * b))
    for e in range(model.neq):
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT:
            continue
        one, other = data.site(model.eq_obj1id[e]), data.site(model.eq_obj2id[e])
        worst = max(worst, np.abs(one.xpos - other.xpos).max() / m.length)
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_WELD:
            worst = max(worst, np.abs(one.xmat - other.xmat).max())
    return worst


@pytest.mark.parametrize('name', LOOPS)
def test_loops_are_closed_as_mujoco_sees_them(name):
    machine = made(name)
    m, w = machine.boxed()
    for q in samples(machine, 20):
        assert close(m, w, q) == FOUND
        assert np.array_equal(w.all[m.actuated], q) and np.array_equal(w.q, q)
        assert open_by(machine, w.all) < 1e-12


@pytest.mark.parametrize('name', LOOPS)
def test_last_bits_do_not_tell_the_way(name):
    machine = made(name)
    few, many = machine.boxed(), machine.boxed()
    targets = samples(machine, 700, seed=1)
    rng = np.random.default_rng(2)
    differ = 0
    for q in targets:
        assert close(*few, q) == FOUND
        for _ in range(3):
            here = q + rng.normal(size=machine.n) * rng.choice([1e-6, 1e-3, 3e-2])
            assert close(*many, here) == FOUND and close(*many, q) == FOUND
            differ += not np.array_equal(few[1].all, many[1].all)
    assert differ == 0  # of 2100


@pytest.mark.parametrize('name', LOOPS)
def test_what_is_only_judged_is_closed_to_six_digits_and_leaves_no_trace(name):
    machine = made(name)
    exact, judging = machine.boxed(), machine.boxed()
    rng, apart = np.random.default_rng(3), []
    for q in samples(machine, 200, seed=4):
        assert close(*exact, q) == FOUND
        for here in (q + rng.normal(size=machine.n) * 1e-2, q):
            assert close_coarsely(*judging, here) == FOUND
            assert open_by(machine, judging[1].all) < 1e-6
        apart.append(np.abs(judging[1].W - exact[1].W).max() / np.abs(exact[1].W).max())
        assert close(*judging, q) == FOUND
        np.testing.assert_array_equal(exact[1].all, judging[1].all)
        np.testing.assert_array_equal(exact[1].W, judging[1].W)
    assert max(apart) < 1e-5


def test_what_is_only_judged_has_the_faults_of_what_is_exact():
    m, w = made('five_bar').boxed()
    assert close_coarsely(m, w, w.q) == FOUND
    assert close_coarsely(m, w, np.array([np.pi, 0.0])) == NOT_CLOSED
    m, w = made('parallelogram').boxed()
    assert close_coarsely(m, w, np.array([3.0])) == FOUND
    assert close_coarsely(m, w, np.array([3.3])) == SINGULAR
    assert close_coarsely(m, w, np.array([np.nan])) == NOT_FINITE


@pytest.mark.parametrize('name', MACHINES)
def test_same_joints_are_the_same_posture(name):
    machine = made(name)
    m, w = machine.boxed()
    q = samples(machine, 1)[0]
    assert close(m, w, q) == FOUND
    before = w.all.copy()
    assert close(m, w, q.copy()) == FOUND
    assert np.array_equal(before, w.all)


@pytest.mark.parametrize('name', LOOPS)
def test_jump_leads_where_small_steps_lead(name):
    machine = made(name)
    m, w = machine.boxed()
    for q in samples(machine, 10, seed=3, near=0.3):
        reset_to_home(m, w)
        assert close(m, w, w.q) == FOUND
        home = w.q.copy()
        fault = close(m, w, q)
        jumped = w.all.copy()
        reset_to_home(m, w)
        slow = [close(m, w, home + s * (q - home)) for s in np.linspace(0.0, 1.0, 300)]
        assert fault == FOUND == max(slow)
        np.testing.assert_allclose(jumped, w.all, rtol=0.0, atol=1e-13)


def test_out_of_reach_is_a_fault_that_changes_nothing():
    m, w = made('five_bar').boxed()
    assert close(m, w, w.q) == FOUND
    before = [np.copy(x) for x in (w.q, w.all, w.rotation, w.W, w.state)]
    assert close(m, w, np.array([np.pi, 0.0])) == NOT_CLOSED  # tips 0.6 m apart, rods of 0.28 m
    for old, new in zip(before, (w.q, w.all, w.rotation, w.W, w.state), strict=True):
        assert np.array_equal(old, new)
    assert close(m, w, w.q + 0.01) == FOUND


def test_way_through_a_singularity_is_a_fault():
    # Cranks of a parallelogram, driven by one: its rod falls in line with them, and at that
    # posture the second crank may go either way.
    machine = made('parallelogram')
    m, w = machine.boxed()
    assert close(m, w, np.array([3.0])) == FOUND
    assert close(m, w, np.array([3.3])) == SINGULAR
    assert w.q[0] == 3.0
    assert close(m, w, np.array([3.1])) == FOUND


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_a_fault(bad):
    for name in MACHINES:
        m, w = made(name).boxed()
        q = w.q.copy()
        q[-1] = bad
        assert close(m, w, q) == NOT_FINITE
        assert np.isfinite(w.q).all()


@pytest.mark.parametrize('name', LOOPS)
def test_rates_keep_the_loops_closed(name):
    machine = made(name)
    m, w = machine.boxed()
    rng = np.random.default_rng(4)
    model, data = machine.model, mujoco.MjData(machine.model)
    h = 1e-5
    for q in samples(machine, 5):
        assert close(m, w, q) == FOUND
        velocity, acceleration = rng.normal(size=(2, machine.n))
        joint_rates(m, w, velocity)
        rate, out = w.rate.copy(), np.zeros_like(w.all)
        data.qpos = w.all
        mujoco.mj_forward(model, data)
        J = [closure_row(m, model, data, k) for k in range(len(m.closure))]
        np.testing.assert_allclose(J @ rate, 0.0, atol=1e-12)
        np.testing.assert_array_equal(rate[m.actuated], velocity)
        all_accelerations(m, w, velocity, acceleration, out)
        ways = []
        for t in (-h, 0.0, h):
            assert close(m, w, q + t * velocity + t * t / 2 * acceleration) == FOUND
            ways.append(w.all.copy())
        before, now, after = ways
        np.testing.assert_allclose((after - before) / (2 * h), rate, rtol=1e-6, atol=1e-7)
        second = (after - 2 * now + before) / h**2
        np.testing.assert_allclose(second, out, rtol=1e-4, atol=1e-4)


def test_many_samples_are_those_one_by_one():
    machine = made('five_bar')
    m, w = machine.boxed()
    q = samples(machine, 6)
    q[2] = np.pi, 0.0
    positions, fault = np.zeros((6, 4)), np.zeros(6, np.int64)
    postures(m, w, q, positions, fault)
    assert fault.tolist() == [FOUND, FOUND, NOT_CLOSED, FOUND, FOUND, FOUND]
    assert np.isnan(positions[2]).all()
    one, u = machine.boxed()
    for k in (0, 1, 3, 4, 5):
        assert close(one, u, q[k]) == FOUND
        assert np.array_equal(positions[k], u.all)
    rotation, origin = np.zeros((6, 4, 3, 3)), np.zeros((6, 4, 3))
    last = w.rotation.copy()
    frames(m, w, positions, rotation, origin)
    assert np.array_equal(w.rotation, last)
    data = mujoco.MjData(machine.model)
    data.qpos = positions[3]
    mujoco.mj_forward(machine.model, data)
    np.testing.assert_allclose(rotation[3].reshape(4, 9), data.xmat[1:], atol=1e-14)
    np.testing.assert_allclose(origin[3], data.xanchor, atol=1e-14)


def test_a_mechanism_that_is_not_square_is_refused():
    m = made('five_bar').mechanism
    with pytest.raises(RobotError, match='2 closures for 1 passive joints'):
        workspace(m._replace(passive=m.passive[:1]))
    with pytest.raises(RobotError, match='1 coordinates of the tool for 2 actuated joints'):
        workspace(m._replace(coordinate=m.coordinate[:1]))
