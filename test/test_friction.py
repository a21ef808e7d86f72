"""Friction against its formula, and against the laws of nature."""

import numpy as np
import pytest
from geometry import rows
from hypothesis import given
from hypothesis import strategies as st
from vectors import on_vectors

from parallel_robot_model.robots import joint_load
from parallel_robot_model.robots.joint_load import FrictionParameters

friction_torque = on_vectors(joint_load.friction_torque)
PAPER = FrictionParameters((2.5, 2.5, 2.5), (0.5, 0.5, 0.5), (0.0,) * 3, 0.01, 0.0)
UNEVEN = FrictionParameters((1.0, 2.0, 3.0), (0.1, 0.2, 0.4), (0.0,) * 3, 0.01, 0.0)


@given(rows(5.0))
def test_friction_of_the_paper_joint_by_joint(velocity):
    expected = 2.5 * velocity + 0.5 * np.sign(velocity)
    assert np.allclose(friction_torque(PAPER, velocity), expected, rtol=1e-15)


def test_every_joint_has_its_own_friction():
    torque = friction_torque(UNEVEN, np.array([1.0, -1.0, 2.0]))
    assert np.allclose(torque, [1.1, -2.2, 6.4], rtol=1e-15)


def test_no_friction_at_rest():
    assert not friction_torque(PAPER, np.zeros(3)).any()


@given(rows(0.1))
def test_dry_friction_falls_from_rest_to_motion(velocity):
    """The curve of Stribeck: 0.9 N m at once, 0.5 + 0.4 / e at its velocity, then 0.5."""
    curve = FrictionParameters((0.0,) * 3, (0.5,) * 3, (0.4,) * 3, 0.02, 0.0)
    expected = np.sign(velocity) * (0.5 + 0.4 * np.exp(-((velocity / 0.02) ** 2)))
    assert np.allclose(friction_torque(curve, velocity), expected, rtol=1e-14)
    torque = friction_torque(curve, np.array([1e-9, -0.02, 1.0]))
    assert np.allclose(torque, [0.9, -0.5 - 0.4 / np.e, 0.5], rtol=1e-12)


@given(rows(5.0), st.sampled_from([0.0, 0.01, 1.0]))
def test_friction_only_takes_energy(velocity, smoothing):
    torque = friction_torque(UNEVEN._replace(smoothing=smoothing), velocity)
    assert (torque * velocity >= np.array(UNEVEN.viscous) * velocity**2).all()


@pytest.mark.parametrize(
    ('velocity', 'sign'), [(0.1, 1), (0.05, 0.5), (-0.025, -0.25), (0.0, 0), (-7.0, -1)]
)
def test_a_smoothed_sign_is_a_ramp(velocity, sign):
    dry = FrictionParameters((0.0,) * 3, (0.5,) * 3, (0.0,) * 3, 0.01, 0.1)
    assert np.allclose(friction_torque(dry, np.full(3, velocity)), 0.5 * sign, rtol=1e-15)
