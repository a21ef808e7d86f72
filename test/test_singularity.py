"""Distances to the singularities against the values of equations.md and plain geometry."""

import numpy as np
import pytest
from geometry import ROBOT, jacobian, legs, poses
from hypothesis import given
from scipy.optimize import brentq
from vectors import boxed

from parallel_robot_model.compiler import vector
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.planar_3rrr import dynamics
from parallel_robot_model.robots.planar_3rrr.dynamics import condition_numbers
from parallel_robot_model.robots.planar_3rrr.kinematics import inverse_kinematics, posture_at

CONSTANTS = boxed(planar_3rrr, ROBOT)


def measures(pose):
    return dynamics.measures(CONSTANTS, posture_at(CONSTANTS, vector(pose)))


def on_circle(phi):
    t = np.linspace(0, 2 * np.pi, 721)
    return np.column_stack([0.49 + 0.03 * np.cos(t), 0.37 + 0.03 * np.sin(t), np.full(721, phi)])


@pytest.mark.parametrize(
    ('phi', 'sine', 'condition'),
    [(np.pi / 2, 0.84, 1.54), (np.pi / 12, 0.39, 1.51), (0.0, 0.35, 1.48)],
)
def test_figures_of_the_papers_circle(phi, sine, condition):
    circle = on_circle(phi)
    found = [inverse_kinematics(CONSTANTS, vector(pose)) for pose in circle]
    sines = [measures(pose).type_1 for pose in circle]
    conditions = condition_numbers(ROBOT, circle[:, 2], np.array([leg.beta for leg in found]))
    assert abs(min(sines) - sine) < 0.005
    assert abs(max(conditions) - condition) < 0.005


@given(poses(0.05))
def test_measures_are_sine_and_determinant(pose):
    theta, beta = legs(ROBOT, pose)
    found = measures(pose)
    sines = np.abs(np.sin(beta - theta))
    singular = np.linalg.svd(jacobian(ROBOT, pose), compute_uv=False)
    assert np.isclose(found.type_1, sines.min(), rtol=1e-12) and found.leg == sines.argmin()
    assert np.isclose(found.type_2, singular.prod(), rtol=1e-9)
    condition = condition_numbers(ROBOT, pose[2:], beta[np.newaxis])[0]
    assert np.isclose(condition, singular[0] / singular[-1], rtol=1e-9)


def test_type_2_vanishes_where_the_lines_of_the_distal_links_meet():
    def side(phi):
        return np.linalg.det(jacobian(ROBOT, [0.5, 0.3, phi]))

    phi = brentq(side, -np.pi / 2, 0.5)
    assert measures([0.5, 0.3, phi]).type_2 < 1e-12


def test_the_stretched_leg_is_named():
    corner = ROBOT.l3 * np.exp(1j * ROBOT.platform_angle[1])
    target = 1.0 + 0.99999 * np.exp(2.3j) - corner  # leg 2, one hundredth of a millimetre short
    pose = np.array([target.real, target.imag, 0.0])
    found = measures(pose)
    assert np.isfinite(legs(ROBOT, pose)[0]).all() and found.leg == 1 and found.type_1 < 0.02
