"""Equations of motion against energies by finite differences and Lagrange's equations."""

import numpy as np
from geometry import ROBOT, kinetic_energy, legs, poses, rows
from hypothesis import given
from vectors import OnVectors, boxed

from parallel_robot_model.compiler import vector
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.contract import PoseMotion
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
)
from parallel_robot_model.robots.planar_3rrr.dynamics import (
    actuated_dynamics,
    map_rates,
    pose_coriolis,
    pose_inertia,
    rates_of,
    velocity_maps,
)
from parallel_robot_model.robots.planar_3rrr.kinematics import posture_at

STILL = np.zeros(3)
MODEL = OnVectors(planar_3rrr)
CONSTANTS = boxed(planar_3rrr, ROBOT)
FREE = JointLoad(
    FrictionParameters((0.0,) * 3, (0.0,) * 3, (0.0,) * 3, 0.01, 0.0, *((0.0,) * 3,) * 2),
    DisturbanceParameters((0.0,) * 3, 0.0, (0.0,) * 3),
)


def actuated(pose, theta_dot):
    posture = posture_at(CONSTANTS, vector(pose))
    return actuated_dynamics(CONSTANTS, posture, vector(theta_dot))


def pose_dynamics(pose, rate):
    """M_x, Q_x and H, each shape (3, 3)."""
    posture = posture_at(CONSTANTS, vector(pose))
    maps = velocity_maps(CONSTANTS, posture)
    rates = rates_of(maps, vector(rate))
    M_x = np.array(pose_inertia(CONSTANTS, posture, maps))
    maps_dot = map_rates(CONSTANTS, posture, maps, rates)
    Q_x = pose_coriolis(CONSTANTS, posture, maps, maps_dot, rates)
    return M_x, np.array(Q_x), np.array(maps.H)


def jacobian(pose):
    """J of Xdot = J thetadot."""
    return np.linalg.inv(pose_dynamics(pose, STILL)[2])


def test_check_value_of_equations_md():
    M, Q, _ = actuated(np.array([0.52, 0.37, np.pi / 12]), STILL)
    expected = [[1.507, -0.267, -0.028], [-0.267, 1.433, -0.093], [-0.028, -0.093, 0.956]]
    assert np.abs(M - expected).max() < 6e-4  # they are given with three digits
    assert not Q.any()


@given(poses(), rows(2.0))
def test_inertia_is_symmetric_and_positive_definite(pose, theta_dot):
    M = actuated(pose, theta_dot).M
    M_x = pose_dynamics(pose, STILL)[0]
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0 and np.linalg.eigvalsh(M_x).min() > 0


@given(poses(), rows(2.0))
def test_inertia_gives_the_energy_of_the_bodies(pose, rate):
    theta_dot = np.linalg.solve(jacobian(pose), rate)
    M_x = pose_dynamics(pose, rate)[0]
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
        return pose_dynamics(p, rate)

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
        return actuated(MODEL.locate(ROBOT, angles, pose).pose, STILL).M

    slope = [(inertia(theta + d) - inertia(theta - d)) / (2 * h) for d in h * np.eye(3)]
    M_dot = sum(rate * dM for rate, dM in zip(theta_dot, slope, strict=True))
    lagrange = M_dot @ theta_dot - 0.5 * np.array([theta_dot @ dM @ theta_dot for dM in slope])
    force = actuated(pose, theta_dot).Q @ theta_dot
    assert np.allclose(force, lagrange, rtol=1e-5, atol=1e-6 * max(1.0, np.abs(force).max()))


@given(poses(), rows(1.0), rows(1.0))
def test_both_coordinates_describe_one_motion(pose, rate, acceleration):
    motion = MODEL.joint_motion(ROBOT, PoseMotion(pose, rate, acceleration))
    M_x, Q_x, H = pose_dynamics(pose, rate)
    M, Q, _ = actuated(pose, motion.velocity)
    torque = M @ motion.acceleration + Q @ motion.velocity
    wrench = M_x @ acceleration + Q_x @ rate
    assert np.allclose(H.T @ torque, wrench, rtol=1e-9, atol=1e-9 * np.abs(wrench).max())
    given_back = MODEL.acceleration(ROBOT, FREE, pose, rate, torque, 0.0)
    scale = max(1.0, np.abs(np.linalg.solve(M_x, Q_x @ rate)).max())
    assert np.allclose(given_back, acceleration, rtol=1e-8, atol=1e-9 * scale)
