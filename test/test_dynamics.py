"""Equations of motion against energies by finite differences and Lagrange's equations."""

import numpy as np
from geometry import ROBOT, kinetic_energy, legs, poses, rows
from hypothesis import given

from parallel_robot_model.planar_3rrr import locate
from parallel_robot_model.planar_3rrr.dynamics import actuated_dynamics, pose_dynamics
from parallel_robot_model.planar_3rrr.kinematics import velocity_maps

STILL = np.zeros(3)


def actuated(pose, theta_dot):
    return actuated_dynamics(ROBOT, pose[2], *legs(ROBOT, pose), theta_dot)


def jacobian(pose):
    """J of Xdot = J thetadot."""
    return np.linalg.inv(velocity_maps(ROBOT, pose[2], *legs(ROBOT, pose), STILL).H)


def test_check_value_of_equations_md():
    M, Q, _ = actuated(np.array([0.52, 0.37, np.pi / 12]), STILL)
    expected = [[1.507, -0.267, -0.028], [-0.267, 1.433, -0.093], [-0.028, -0.093, 0.956]]
    assert np.abs(M - expected).max() < 6e-4  # they are given with three digits
    assert not Q.any()


@given(poses(), rows(2.0))
def test_inertia_is_symmetric_and_positive_definite(pose, theta_dot):
    M = actuated(pose, theta_dot).M
    M_x = pose_dynamics(ROBOT, pose[2], *legs(ROBOT, pose), jacobian(pose) @ theta_dot)[0]
    assert np.array_equal(M, M.T)
    assert np.allclose(M_x, M_x.T, rtol=1e-13, atol=1e-13 * np.abs(M_x).max())
    assert np.linalg.eigvalsh(M).min() > 0 and np.linalg.eigvalsh(M_x).min() > 0


@given(poses(), rows(2.0))
def test_inertia_gives_the_energy_of_the_bodies(pose, rate):
    theta_dot = np.linalg.solve(jacobian(pose), rate)
    M_x = pose_dynamics(ROBOT, pose[2], *legs(ROBOT, pose), rate)[0]
    energy = kinetic_energy(ROBOT, pose, rate)
    assert np.isclose(0.5 * rate @ M_x @ rate, energy, rtol=1e-6, atol=1e-9)
    M = actuated(pose, theta_dot).M
    assert np.isclose(0.5 * theta_dot @ M @ theta_dot, energy, rtol=1e-6, atol=1e-9)


@given(poses(), rows(1.0))
def test_inertia_rate_less_twice_coriolis_is_skew(pose, rate):
    h = 1e-6
    theta_dot = np.linalg.solve(jacobian(pose), rate)
    change = actuated(pose + h * rate, theta_dot).M - actuated(pose - h * rate, theta_dot).M
    M_dot, Q = change / (2 * h), actuated(pose, theta_dot).Q
    skew = M_dot - 2 * Q
    assert np.abs(skew + skew.T).max() < 1e-6 * max(1.0, np.abs(Q).max())


@given(poses(), rows(1.0))
def test_pose_inertia_rate_less_twice_coriolis_is_skew(pose, rate):
    def matrices(p):
        return pose_dynamics(ROBOT, p[2], *legs(ROBOT, p), rate)

    h = 1e-6
    M_dot = (matrices(pose + h * rate)[0] - matrices(pose - h * rate)[0]) / (2 * h)
    Q = matrices(pose)[1]
    skew = M_dot - 2 * Q
    assert np.abs(skew + skew.T).max() < 1e-6 * max(1.0, np.abs(Q).max())


@given(poses(0.3), rows(1.0))
def test_coriolis_forces_are_those_of_lagrange(pose, theta_dot):
    theta = legs(ROBOT, pose)[0]
    h = 1e-5

    def inertia(angles):
        return actuated(locate(ROBOT, angles, pose).pose, STILL).M

    slope = [(inertia(theta + d) - inertia(theta - d)) / (2 * h) for d in h * np.eye(3)]
    M_dot = sum(rate * dM for rate, dM in zip(theta_dot, slope, strict=True))
    lagrange = M_dot @ theta_dot - 0.5 * np.array([theta_dot @ dM @ theta_dot for dM in slope])
    force = actuated(pose, theta_dot).Q @ theta_dot
    assert np.allclose(force, lagrange, rtol=1e-5, atol=1e-6 * max(1.0, np.abs(force).max()))


@given(poses(), rows(1.0), rows(1.0))
def test_both_coordinates_describe_one_motion(pose, rate, acceleration):
    maps = velocity_maps(ROBOT, pose[2], *legs(ROBOT, pose), rate)
    theta_dot, theta_ddot = maps.H @ rate, maps.H @ acceleration + maps.H_dot @ rate
    M_x, Q_x, H, H_dot = pose_dynamics(ROBOT, pose[2], *legs(ROBOT, pose), rate)
    assert np.array_equal(H, maps.H) and np.array_equal(H_dot, maps.H_dot)
    M, Q, _ = actuated(pose, theta_dot)
    torque = M @ theta_ddot + Q @ theta_dot
    wrench = M_x @ acceleration + Q_x @ rate
    assert np.allclose(H.T @ torque, wrench, rtol=1e-9, atol=1e-9 * np.abs(wrench).max())
