"""Distances to the singularities against the values of equations.md and plain geometry."""

import numpy as np
import pytest
from geometry import ROBOT, legs, margins, poses
from hypothesis import given

from parallel_robot_model.kinematics import Legs, inverse_kinematics
from parallel_robot_model.singularity import condition_number, measures


def on_circle(phi):
    t = np.linspace(0, 2 * np.pi, 721)
    return np.column_stack([0.49 + 0.03 * np.cos(t), 0.37 + 0.03 * np.sin(t), np.full(721, phi)])


@pytest.mark.parametrize(
    ('phi', 'sine', 'condition'),
    [(np.pi / 2, 0.84, 1.54), (np.pi / 12, 0.39, 1.51), (0.0, 0.35, 1.48)],
)
def test_figures_of_the_papers_circle(phi, sine, condition):
    circle = on_circle(phi)
    found = [inverse_kinematics(ROBOT, pose) for pose in circle]
    sines = [measures(ROBOT, phi, leg.theta, leg.beta).type_1 for leg in found]
    conditions = [
        condition_number(ROBOT, pose, leg) for pose, leg in zip(circle, found, strict=True)
    ]
    assert abs(min(sines) - sine) < 0.005
    assert abs(max(conditions) - condition) < 0.005


@given(poses(0.05))
def test_measures_are_sine_and_determinant(pose):
    theta, beta = legs(ROBOT, pose)
    found = measures(ROBOT, pose[2], theta, beta)
    sines = np.abs(np.sin(beta - theta))
    distal = np.exp(1j * beta)
    corner = np.exp(1j * (pose[2] + np.array(ROBOT.platform_angle)))
    jacobian = np.column_stack([distal.real, distal.imag, (corner.conj() * distal).imag])
    assert np.isclose(found.type_1, sines.min(), rtol=1e-12) and found.leg == sines.argmin()
    assert np.isclose(found.type_2, abs(np.linalg.det(jacobian)), rtol=1e-9)
    singular = np.linalg.svd(jacobian, compute_uv=False)
    condition = condition_number(ROBOT, pose, Legs(theta, beta, -1))
    assert np.isclose(condition, singular[0] / singular[-1], rtol=1e-9)


def test_measures_vanish_where_the_robot_yields():
    # Symmetric about the centre of the base: all distal links point at one spot for some phi.
    centre = np.array([0.5, np.sqrt(3) / 6])
    angles = np.linspace(-np.pi, np.pi, 200001)
    reach = [margins(ROBOT, [*centre, phi])[1] for phi in angles[::100]]
    phi = angles[::100][int(np.argmin(np.where(np.array(reach) == 0, np.inf, reach)))]
    fine = phi + np.linspace(-0.004, 0.004, 8001)
    found = [
        measures(ROBOT, p, *legs(ROBOT, np.array([*centre, p]))).type_2 for p in fine
    ]  # fmt: skip
    assert min(found) < 1e-4


def test_the_stretched_leg_is_named():
    corner = ROBOT.l3 * np.exp(1j * ROBOT.platform_angle[1])
    target = 1.0 + 0.99999 * np.exp(2.3j) - corner  # leg 2, one hundredth of a millimetre short
    pose = np.array([target.real, target.imag, 0.0])
    theta, beta = legs(ROBOT, pose)
    found = measures(ROBOT, 0.0, theta, beta)
    assert np.isfinite(theta).all() and found.leg == 1 and found.type_1 < 0.02
