"""Kinematics against complex-number geometry, finite differences and an integrated path."""

import numpy as np
import pytest
from geometry import (
    PAPER_START,
    PI12_START,
    ROBOT,
    closure,
    corners,
    jacobian,
    legs,
    margins,
    poses,
    rows,
    wrap,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from vectors import boxed, on_vectors

from parallel_robot_model.common.errors import KinematicsError
from parallel_robot_model.compiler import cross, dot, multiply, solve, vector
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.contract import FOUND
from parallel_robot_model.robots.planar_3rrr import dynamics, kinematics
from parallel_robot_model.robots.planar_3rrr import forward_kinematics as forward
from parallel_robot_model.robots.planar_3rrr.dynamics import inverse_rows
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import (
    GUESS_OUT_OF_REACH,
    NOT_CONVERGED,
)
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import ROBOTS, RobotModel

MODEL = RobotModel('planar_3rrr', ROBOTS['planar_3rrr'], ROBOT)
MIRRORED = ROBOT._replace(working_mode=(-1.0, -1.0, -1.0))
MIXED = ROBOT._replace(working_mode=(1.0, -1.0, 1.0))
COLLINEAR = ROBOT._replace(base_x=(0.0, 1.0, 0.5), base_y=(0.0, 0.0, 0.0))
MODES = {'paper': ROBOT, 'mirrored': MIRRORED, 'mixed': MIXED, 'collinear base': COLLINEAR}


def inverse_kinematics(robot, pose):
    return kinematics.inverse_kinematics(boxed(planar_3rrr, robot), vector(pose))


def forward_kinematics(robot, theta, guess):
    return forward.forward_kinematics(boxed(planar_3rrr, robot), vector(theta), vector(guess))


def posture_at(pose):
    return kinematics.posture_at(boxed(planar_3rrr, ROBOT), vector(pose))


def beta_of(found):
    return np.arctan2(found.posture.sb, found.posture.cb)


def matrix(columns):
    return np.column_stack(columns)


@pytest.mark.parametrize('robot', MODES.values(), ids=MODES)
@given(st.tuples(st.floats(-1, 2), st.floats(-1, 2), st.floats(-10, 10)).map(np.array))
def test_inverse_kinematics_closes_every_leg_that_reaches(robot, pose):
    found = inverse_kinematics(robot, pose)
    theta, beta = legs(robot, pose)
    reach = ~np.isnan(theta)
    if reach.all():
        assert found.out_of_reach == -1
        if np.abs(np.sin(beta - theta)).min() > 1e-4:
            assert np.abs(wrap(found.theta - theta)).max() < 1e-9
            assert closure(robot, pose, found.theta, found.beta).max() < 1e-12
            assert np.abs(wrap(found.psi - (beta - theta))).max() < 1e-9
    else:
        assert found.out_of_reach == np.flatnonzero(~reach)[0]
        assert np.array_equal(np.isnan(found.theta), ~reach)


def test_joint_angles_are_continuous_where_a_leg_points_along_minus_x():
    s = np.linspace(0, 2 * np.pi, 20001)
    path = np.column_stack([0.5 + 0.1 * np.cos(s), 0.2 + 0.1 * np.sin(s), 0.3 * np.sin(3 * s)])
    theta = np.array([inverse_kinematics(ROBOT, pose).theta for pose in path])
    assert np.ptp(np.sign(corners(ROBOT, path)[:, 1].imag)) == 2
    assert np.abs(np.diff(theta, axis=0)).max() < 0.01


@given(poses(), rows(1.0))
def test_velocity_maps_are_the_derivatives_of_the_joint_angles(pose, rate):
    maps = dynamics.velocity_maps(boxed(planar_3rrr, ROBOT), posture_at(pose))
    h = 1e-5
    for j, shift in enumerate(h * np.eye(3)):
        for column, angles in ((maps.H[:, j], 0), (maps.K[:, j], 1)):
            change = legs(ROBOT, pose + shift)[angles] - legs(ROBOT, pose - shift)[angles]
            assert np.allclose(column, wrap(change) / (2 * h), rtol=1e-5, atol=1e-6)
    rates = dynamics.rates_of(maps, vector(rate))
    assert np.allclose(rates.theta, np.array(maps.H) @ rate, rtol=1e-13, atol=1e-13)
    assert np.allclose(rates.beta, np.array(maps.K) @ rate, rtol=1e-13, atol=1e-13)
    assert rates.phi == rate[2]


@given(poses(), rows(1.0))
def test_rates_of_the_velocity_maps_are_their_derivatives_along_the_motion(pose, rate):
    robot, h = boxed(planar_3rrr, ROBOT), 1e-6

    def maps(p):
        return dynamics.velocity_maps(robot, posture_at(p))

    here, ahead, behind = maps(pose), maps(pose + h * rate), maps(pose - h * rate)
    rates = dynamics.rates_of(here, vector(rate))
    changes = dynamics.map_rates(robot, posture_at(pose), here, rates)
    apart = dynamics.centripetal(robot, posture_at(pose), rates)
    for change, plus, minus, rest in zip(
        map(np.array, changes), ahead, behind, apart, strict=True
    ):
        scale = max(1.0, np.abs(change).max())
        assert np.abs(change - np.array(plus - minus) / (2 * h)).max() < 1e-5 * scale
        assert np.allclose(change @ rate, rest, rtol=1e-9, atol=1e-11 * scale)


@given(poses(), rows(1.0))
def test_jacobians_relate_the_rates(pose, rate):
    robot, posture, h = boxed(planar_3rrr, ROBOT), posture_at(pose), 1e-5
    theta_dot = wrap(legs(ROBOT, pose + h * rate)[0] - legs(ROBOT, pose - h * rate)[0]) / (2 * h)
    left = matrix(dynamics.jacobian_x(robot, posture)) @ rate
    assert np.allclose(left, dynamics.jacobian_q(robot, posture) * theta_dot, atol=1e-6)


@given(rows(2.0, 9), rows(2.0))
def test_small_linear_algebra(numbers, x):
    a = numbers.reshape(3, 3) + 5 * np.eye(3)
    *rows, determinant = inverse_rows(dynamics.Columns(*map(vector, a.T)))
    assert np.isclose(determinant, np.linalg.det(a), rtol=1e-12)
    assert np.allclose(rows, np.linalg.inv(a), rtol=1e-10, atol=1e-12)
    assert np.allclose(on_vectors(multiply)(a, x), a @ x, rtol=1e-14, atol=1e-14)
    assert np.array_equal(multiply(a, x), on_vectors(multiply)(a, x))
    assert np.isclose(on_vectors(dot)(a[0], x), a[0] @ x, rtol=1e-14, atol=1e-14)
    assert np.allclose(on_vectors(cross)(a[0], x), np.cross(a[0], x), rtol=1e-14, atol=1e-14)


def test_a_singular_matrix_has_no_finite_inverse():
    one = vector(np.ones(3))
    *rows, determinant = inverse_rows(dynamics.Columns(one, one, one))
    assert not np.isfinite(rows).any() and determinant == 0.0
    assert not np.isfinite(on_vectors(solve)(np.zeros((3, 3)), np.ones(3))).any()


@pytest.mark.parametrize('n', range(1, 7))
def test_equations_with_an_inertia_matrix_are_solved(n):
    """From well to badly conditioned: the residual counts, and only the lower triangle is read."""
    draw = np.random.default_rng(n).standard_normal
    for smallest in (1.0, 1e-3, 1e-8):
        axes = np.linalg.qr(draw((n, n)))[0]
        a = axes * np.geomspace(smallest, 1.0, n) @ axes.T
        b = draw(n)
        x = on_vectors(solve)(np.tril(a), b)
        assert np.allclose(a @ x, b, atol=1e-12 * np.abs(x).max())
        assert np.allclose(x, np.linalg.solve(a, b), rtol=1e-13 / smallest)
        assert np.array_equal(x, solve(np.tril(a), b))


@given(poses(), rows(1.0))
def test_forward_kinematics_inverts_inverse_kinematics(pose, error):
    theta, beta = legs(ROBOT, pose)
    guess = pose + np.array([0.01, 0.01, 0.05]) * error
    assume(min(margins(ROBOT, guess)) > 0.05)
    found = forward_kinematics(ROBOT, theta, guess)
    assert found.status == FOUND
    assert np.abs(found.pose - pose).max() < 1e-9
    assert np.abs(wrap(beta_of(found) - beta)).max() < 1e-9


@given(poses(), rows(1.0), st.lists(st.integers(-3, 3), min_size=3, max_size=3))
def test_whole_turns_of_the_motors_do_not_matter(pose, error, turns):
    guess = pose + 0.01 * error
    assume(min(margins(ROBOT, guess)) > 0.05)
    theta = legs(ROBOT, pose)[0] + 2 * np.pi * np.array(turns)
    found = forward_kinematics(ROBOT, theta, guess)
    assert found.status == FOUND and np.abs(found.pose - pose).max() < 1e-9


def test_the_papers_start_has_two_assembly_modes_and_the_guess_decides():
    theta = legs(ROBOT, PAPER_START)[0]
    other = np.array([0.490, 0.377, -3.07])
    near_paper = forward_kinematics(ROBOT, theta, PAPER_START + np.array([0.01, -0.01, 0.05]))
    near_other = forward_kinematics(ROBOT, theta, other)
    assert near_paper.status == near_other.status == FOUND
    assert np.abs(near_paper.pose - PAPER_START).max() < 1e-12
    assert np.abs(near_other.pose - other).max() < 5e-3
    for found in (near_paper, near_other):
        assert closure(ROBOT, found.pose, theta, beta_of(found)).max() < 1e-12


def scatter(seed):
    """Distance from a pose to a far guess; few of them are short."""
    return np.random.default_rng(seed).uniform(-1, 1, 3) * [0.2, 0.2, 2.5]


def follow(robot, theta, guess):
    """Integrate the pose along the straight line of angles from the guess's to `theta`.

    Returns the pose at the end, or None, and the smallest singular value met on the way.
    """
    start = legs(robot, guess)[0]
    change = wrap(theta - start)

    def matrices(share, pose):
        x, y, phi = pose
        platform = robot.l3 * np.exp(1j * (phi + np.array(robot.platform_angle)))
        angles = np.exp(1j * (start + share * change))
        base = np.array(robot.base_x) + 1j * np.array(robot.base_y)
        distal = (x + 1j * y + platform - base - robot.l1 * angles) / robot.l2
        turn = (np.conj(distal) * 1j * platform).real
        drive = (np.conj(distal) * 1j * robot.l1 * angles).real * change
        return np.column_stack([distal.real, distal.imag, turn / robot.l3]), drive

    def slope(share, pose):
        matrix, drive = matrices(share, pose)
        if abs(np.linalg.det(matrix)) < 1e-9:
            return np.zeros(3)
        return np.linalg.solve(matrix, drive) / [1, 1, robot.l3]

    def singular(share, pose):
        return abs(np.linalg.det(matrices(share, pose)[0])) - 0.01

    singular.terminal = True
    path = solve_ivp(slope, (0, 1), guess, rtol=1e-8, atol=1e-9, events=singular, max_step=0.1)
    smallest = min(
        np.linalg.svd(matrices(s, p)[0], compute_uv=False)[-1]
        for s, p in zip(path.t, path.y.T, strict=True)
    )
    return (path.y[:, -1] if path.status == 0 else None), smallest


@settings(max_examples=300)
@given(poses(0.1), st.integers(0, 10**6).map(scatter))
def test_a_far_guess_gives_the_pose_continuous_with_it_or_a_failure(pose, shift):
    theta, guess = legs(ROBOT, pose)[0], pose + shift
    assume(min(margins(ROBOT, guess)) > 0.05)
    found = forward_kinematics(ROBOT, theta, guess)
    end, smallest = follow(ROBOT, theta, guess)
    if found.status == FOUND:
        assert closure(ROBOT, found.pose, theta, beta_of(found)).max() < 1e-9
        assert end is not None, f'passed a singularity, {smallest}'
        assert np.abs(found.pose - end).max() < 1e-4
    elif end is not None and smallest > 0.3:  # far from type 2 it must arrive, or be folded
        assert np.abs(wrap(legs(ROBOT, end)[0] - theta)).max() > 1e-6


def test_a_folded_elbow_is_reported():
    pose = np.array([0.5, 0.3, 0.3])
    theta = legs(MIXED, pose)[0]
    for guess in (pose, pose + np.array([0.1, 0.1, 0.5])):
        assert forward_kinematics(ROBOT, theta, guess).status != FOUND


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('leg', [0, 1, 2])
def test_input_that_is_not_finite_is_a_failure(bad, leg):
    theta = legs(ROBOT, PAPER_START)[0]
    angles, guess = theta.copy(), PAPER_START.copy()
    angles[leg] = guess[leg] = bad
    assert forward_kinematics(ROBOT, angles, PAPER_START).status == NOT_CONVERGED
    assert forward_kinematics(ROBOT, theta, guess).status == GUESS_OUT_OF_REACH


def test_angles_that_no_pose_fits_are_a_failure():
    outwards = np.array([-3 * np.pi / 4, -np.pi / 4, np.pi / 2])
    assert forward_kinematics(ROBOT, outwards, PAPER_START).status != FOUND


@pytest.mark.parametrize('start', [PAPER_START, PI12_START])
def test_a_row_of_angles_is_followed_pose_by_pose(start):
    t = np.linspace(0, 2 * np.pi, 400)[:, None]
    path = start + 0.03 * np.hstack([np.cos(t) - 1, np.sin(t), np.sin(t)])
    theta = legs(ROBOT, path)[0]
    assert np.abs(poses_of(MODEL, theta, start) - path).max() < 1e-9


def test_a_row_that_breaks_names_the_sample():
    theta = np.tile(legs(ROBOT, PAPER_START)[0], (5, 1))
    theta[3, 1] = np.nan
    with pytest.raises(KinematicsError, match='sample 3'):
        poses_of(MODEL, theta, PAPER_START)


@given(poses(0.1), rows(1.0))
def test_the_branch_never_changes_under_small_steps(pose, step):
    found = forward_kinematics(ROBOT, legs(ROBOT, pose + 0.02 * step)[0], pose)
    if found.status == FOUND:
        before, after = (np.linalg.det(jacobian(ROBOT, p)) for p in (pose, found.pose))
        assert before * after > 0
