"""Poses of tools and the way back to the joints, with two derivatives."""

import math

import mujoco
import numpy as np
import pytest
from mjcf_machines import MACHINES, compiled, machine, made, samples, serial_2r
from scipy.spatial.transform import Rotation
from test_serial_2r import ARM

from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.margins import margins, margins_hold
from parallel_robot_model.mechanisms.mechanism import (
    FOUND,
    NOT_CLOSED,
    NOT_FINITE,
    SINGULAR,
)
from parallel_robot_model.mechanisms.pose_solving import pose_motion, solve_pose
from parallel_robot_model.mechanisms.tool import tool_motion, tool_pose
from parallel_robot_model.mechanisms.workspace import reset_to_home

EVERY = pytest.mark.parametrize('name', MACHINES)


def pose_at(boxed, q):
    pose = np.zeros(len(q))
    assert close(*boxed, q) == FOUND
    tool_pose(*boxed, pose)
    return pose


@EVERY
def test_poses_are_those_of_mujoco(name):
    machine = made(name)
    m, w = boxed = machine.boxed()
    data = mujoco.MjData(machine.model)
    for q in samples(machine, 10):
        pose = pose_at(boxed, q)
        if not len(m.coordinate):
            assert np.array_equal(pose, q)
            continue
        data.qpos = w.all
        mujoco.mj_forward(machine.model, data)
        turned = data.site('tool').xmat.reshape(3, 3) @ m.tool_home.T
        vector = Rotation.from_matrix(turned).as_rotvec()
        known = np.concatenate([data.site('tool').xpos, vector])[m.coordinate]
        np.testing.assert_allclose(pose, known, rtol=0.0, atol=1e-13)


@EVERY
def test_rate_of_the_pose_is_its_slope(name):
    machine = made(name)
    m, w = boxed = machine.boxed()
    h, pose, rate = 1e-5, np.zeros(machine.n), np.zeros(machine.n)
    for q in samples(machine, 5):
        for j in range(machine.n):
            speed = np.eye(machine.n)[j]
            slope = (pose_at(boxed, q + h * speed) - pose_at(boxed, q - h * speed)) / (2 * h)
            assert close(m, w, q) == FOUND
            tool_motion(m, w, speed, pose, rate)
            np.testing.assert_allclose(rate, slope, atol=1e-8)
            np.testing.assert_array_equal(w.tool_jacobian[:, j], rate)


@EVERY
def test_joints_of_a_pose_lead_to_it(name):
    machine = made(name)
    m, w = machine.boxed()
    other = machine.boxed()
    for q in samples(machine, 30):
        pose = pose_at(other, q)
        assert solve_pose(m, w, pose) == FOUND
        np.testing.assert_allclose(w.q, q, rtol=0.0, atol=1e-12)
        again = np.zeros(machine.n)
        tool_pose(m, w, again)
        np.testing.assert_allclose(again, pose, rtol=0.0, atol=1e-14)


@EVERY
def test_last_bits_do_not_tell_the_way(name):
    machine = made(name)
    few, many, closed = machine.boxed(), machine.boxed(), machine.boxed()
    rng = np.random.default_rng(2)
    differ, otherwise, count = 0, 0, 0
    for q in samples(machine, 300, seed=1):
        pose = pose_at(closed, q)
        assert solve_pose(*few, pose) == FOUND
        for _ in range(3):
            here = q + rng.normal(size=machine.n) * rng.choice([1e-6, 1e-3, 3e-2])
            assert close(*many, here) == FOUND and solve_pose(*many, pose) == FOUND
            differ += not np.array_equal(few[1].all, many[1].all)
            count += 1
        assert close(*closed, few[1].q) == FOUND
        otherwise += not np.array_equal(few[1].all, closed[1].all)
    assert differ <= 1e-4 * count
    assert otherwise <= 1  # and they are the posture of their joints


@EVERY
def test_motion_of_the_joints_has_the_slopes_of_their_positions(name):
    machine = made(name)
    m, w = machine.boxed()
    n, rng, h = machine.n, np.random.default_rng(3), 1e-4
    position, velocity, acceleration = np.zeros((3, n))
    for q in samples(machine, 5):
        pose = pose_at((m, w), q)
        rate, bent = rng.uniform(-0.5, 0.5, (2, n))
        ways = []
        for t in (-2 * h, -h, 0.0, h, 2 * h):
            assert solve_pose(m, w, pose + t * rate + t * t / 2 * bent) == FOUND
            ways.append(w.q.copy())
        assert solve_pose(m, w, pose) == FOUND
        assert pose_motion(m, w, rate, bent, position, velocity, acceleration) == FOUND
        a, b, c, d, e = ways
        np.testing.assert_array_equal(position, w.q)
        np.testing.assert_allclose(velocity, (8 * (d - b) - (e - a)) / (12 * h), atol=1e-9)
        second = (16 * (b + d) - (a + e) - 30 * c) / (12 * h * h)
        scale = max(1.0, np.abs(acceleration).max())
        np.testing.assert_allclose(acceleration, second, atol=1e-6 * scale)
        found = np.zeros(n)
        tool_motion(m, w, velocity, position, found)
        np.testing.assert_allclose(found, rate, atol=1e-12)


def test_one_angle_goes_on_beyond_half_a_turn():
    m, w = turntable().boxed()
    pose = np.zeros(2)
    for angle in np.linspace(0.0, 11.0, 50):
        assert close(m, w, np.array([0.5, angle])) == FOUND
        tool_pose(m, w, pose)
        np.testing.assert_allclose(pose, [0.5, angle], atol=1e-13)
    assert close(m, w, np.array([0.2, -7.0])) == FOUND  # at one jump
    tool_pose(m, w, pose)
    np.testing.assert_allclose(pose, [0.2, -7.0], atol=1e-13)
    assert solve_pose(m, w, np.array([0.1, 8.0])) == FOUND
    np.testing.assert_allclose(w.q, [0.1, 8.0], atol=1e-14)
    reset_to_home(m, w)
    assert close(m, w, w.q) == FOUND
    tool_pose(m, w, pose)
    assert pose.tolist() == [0.0, 0.0]


def turntable():
    """A slide and a hinge along z."""
    body = '<inertial pos=".1 0 0" mass="1" diaginertia=".1 .1 .1"/>'
    model = compiled(
        f'<body><joint name="s" type="slide" axis="0 0 1"/>{body}<body>'
        f'<joint name="h" axis="0 0 1"/>{body}<site name="tool"/></body></body>',
        actuated=['s', 'h'],
    )
    return machine(model, None, (2, 5), 0.5)


def test_a_stretched_arm_cannot_follow_a_pose():
    m, w = serial_2r(ARM).boxed()
    assert close(m, w, np.array([0.4, 0.0])) == FOUND
    pose = np.zeros(2)
    tool_pose(m, w, pose)
    assert solve_pose(m, w, 0.9 * pose) == SINGULAR
    assert pose_motion(m, w, pose, pose, *np.zeros((3, 2))) == SINGULAR
    assert margins(m, w)[1] < 1e-7
    assert close(m, w, np.array([0.4, 0.5])) == FOUND
    assert solve_pose(m, w, 0.9 * pose) == FOUND
    assert solve_pose(m, w, 1.1 * pose) == NOT_CLOSED


def test_pose_beyond_a_singularity_of_the_loops_is_a_fault():
    # The rods of the five-bar fall in line: its tip may go on, its cranks do not hold it there.
    m, w = made('five_bar').boxed()
    pose = np.zeros(2)
    assert close(m, w, w.q) == FOUND
    tool_pose(m, w, pose)
    assert solve_pose(m, w, pose * np.array([1.0, 0.9])) == FOUND
    signs = w.state[1]
    fault = solve_pose(m, w, pose * np.array([1.0, -0.2]))
    assert fault == SINGULAR and w.state[1] == signs
    assert margins(m, w)[0] > 0.0


@pytest.mark.parametrize('angle', [1e-9, 0.3, 2.0, 3.1])
def test_motion_at_large_rotations(angle):
    machine = made('arm')
    m, w = machine.boxed()
    other = machine.boxed()
    pose, h = pose_at((m, w), np.array([0.2, 0.5, 0.4, 0.3, 0.6, 0.1])), 1e-4
    pose[3:] *= angle / np.linalg.norm(pose[3:])
    assert solve_pose(m, w, pose) == FOUND
    np.testing.assert_allclose(pose_at(other, w.q), pose, atol=1e-12)
    rng = np.random.default_rng(12)
    rate, bent = rng.uniform(-0.3, 0.3, (2, 6))
    ways = []
    for t in (-2 * h, -h, 0.0, h, 2 * h):
        assert solve_pose(m, w, pose + t * rate + t * t / 2 * bent) == FOUND
        ways.append(w.q.copy())
    assert solve_pose(m, w, pose) == FOUND
    position, velocity, acceleration = np.zeros((3, 6))
    assert pose_motion(m, w, rate, bent, position, velocity, acceleration) == FOUND
    a, b, c, d, e = ways
    size = max(1.0, np.abs(acceleration).max())
    np.testing.assert_allclose(velocity, (8 * (d - b) - (e - a)) / (12 * h), atol=1e-8 * size)
    second = (16 * (b + d) - (a + e) - 30 * c) / (12 * h * h)
    np.testing.assert_allclose(acceleration, second, atol=1e-6 * size)


def test_out_of_reach_is_a_fault_that_changes_nothing():
    m, w = made('five_bar').boxed()
    assert close(m, w, w.q) == FOUND
    before = [np.copy(x) for x in (w.q, w.all, w.rotation, w.W, w.angle)]
    pose = np.zeros(2)
    tool_pose(m, w, pose)
    assert solve_pose(m, w, pose + np.array([0.0, 1.0])) == NOT_CLOSED
    for bad in (np.nan, np.inf):
        assert solve_pose(m, w, pose + np.array([0.0, bad])) == NOT_FINITE
    for old, new in zip(before, (w.q, w.all, w.rotation, w.W, w.angle), strict=True):
        assert np.array_equal(old, new)
    assert solve_pose(m, w, pose) == FOUND


@EVERY
def test_margins_are_singular_values(name):
    machine = made(name)
    m, w = machine.boxed()
    for q in samples(machine, 10):
        assert close(m, w, q) == FOUND
        closed, free = margins(m, w)
        r = len(w.error)
        assert closed == pytest.approx(evenness(w.jacobian[:, :r]) if r else 1.0, abs=1e-7)
        assert margins_hold(m, w, closed - 1e-6, free - 1e-6) == (True, True)
        assert margins_hold(m, w, closed + 1e-6, free + 1e-6) == (False, False)
        if not len(m.coordinate):
            assert free == 1.0
            continue
        assert free == pytest.approx(evenness(geometric(machine, w)), abs=1e-7)


@EVERY
def test_margins_are_judged_alike_whatever_was_judged_before(name):
    machine = made(name)
    m, w = machine.boxed()
    r, way = len(w.error), []
    for q in samples(machine, 30, seed=5):  # steps of all sizes, there and back
        way += [m.home[m.actuated] + s * (q - m.home[m.actuated]) for s in (0.9, 0.99, 1.0, 0.4)]
    found, true = [], []
    for q in way:
        assert close(m, w, q) == FOUND
        true.append(evenness(w.jacobian[:, :r]) if r else 1.0)
    least = (1.0 - 1e-6) * 0.5 * (np.median(true) + min(true))  # of some, all are alike
    for q in way:
        close(m, w, q)
        found.append(margins_hold(m, w, least, 0.0)[0])
    assert found == [margin >= least for margin in true]
    assert r == 0 or np.ptp(true) < 1e-6 or not all(found)


def geometric(machine, w):
    """Velocities of the tool by the actuated joints, by MuJoCo, as numbers."""
    m, data, columns = machine.mechanism, mujoco.MjData(machine.model), []
    kind, site = mujoco.mjtObj.mjOBJ_SITE, machine.model.site('tool').id
    for j in range(machine.n):
        data.qpos, data.qvel = w.all, w.W[:, j]
        mujoco.mj_forward(machine.model, data)
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(machine.model, data, kind, site, twist, 0)
        scale = m.length if m.turns[m.actuated[j]] == 0.0 else 1.0
        columns.append(scale * np.concatenate([twist[3:] / m.length, twist[:3]]))
    found = np.transpose(columns)[m.coordinate]
    if np.count_nonzero(m.coordinate >= 3) == 2:  # then rates of the rotation vector count
        found = w.tool_jacobian
    return found


def evenness(a):
    s = np.linalg.svd(a)[1]
    return s[-1] / math.sqrt(np.mean(s * s))


def test_margin_is_zero_where_cranks_and_rods_fall_in_line():
    machine = made('parallelogram')
    m, w = machine.boxed()
    found = []
    for q in (1.0, 0.1, 1e-3, 1e-5):
        assert close(m, w, np.array([q])) == FOUND
        found.append(margins(m, w)[0])
    assert found[0] > 0.3 and np.all(np.diff(found) < 0.0)
    assert 0.0 < found[-1] < 2e-5
