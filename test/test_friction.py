"""Friction against its formula, and against the laws of nature."""

import numpy as np
import pytest
from geometry import rows
from hypothesis import given
from hypothesis import strategies as st
from vectors import on_vectors

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.robots import joint_load
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
    check_friction,
)

friction_torque = on_vectors(joint_load.friction_torque)
net_torque, motor_torque = map(on_vectors, (joint_load.net_torque, joint_load.motor_torque))
NONE = ((0.0,) * 3,) * 2  # constant torque, and friction by load
PAPER = FrictionParameters((2.5, 2.5, 2.5), (0.5, 0.5, 0.5), (0.0,) * 3, 0.01, 0.0, *NONE)
UNEVEN = FrictionParameters((1.0, 2.0, 3.0), (0.1, 0.2, 0.4), (0.0,) * 3, 0.01, 0.0, *NONE)


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
    curve = FrictionParameters((0.0,) * 3, (0.5,) * 3, (0.4,) * 3, 0.02, 0.0, *NONE)
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
    dry = FrictionParameters((0.0,) * 3, (0.5,) * 3, (0.0,) * 3, 0.01, 0.1, *NONE)
    assert np.allclose(friction_torque(dry, np.full(3, velocity)), 0.5 * sign, rtol=1e-15)


LOADED = UNEVEN._replace(offset=(0.3, -0.2, 0.0), load=(0.2, 0.5, 0.0))
LOAD = JointLoad(LOADED, DisturbanceParameters((0.4,) * 3, 0.7, (0.1,) * 3))


@given(rows(5.0), rows(20.0))
def test_a_gear_loses_a_share_of_what_it_transmits(velocity, torque):
    """Driving, 1.2 of what arrives; driven backwards, 0.8: each from its definition alone."""
    plain = LOAD._replace(friction=LOADED._replace(load=(0.0,) * 3))
    arrives = net_torque(LOAD, torque, velocity, 0.25)
    pushed = net_torque(plain, torque, velocity, 0.25)  # without the loss
    against = 0.4 * np.sin(2.0 * np.pi * 0.7 * 0.25 + 0.1)  # after the gear
    lost = np.array(LOADED.load) * np.abs(arrives + against) * np.sign(velocity)
    assert np.allclose(arrives + lost, pushed, rtol=1e-12, atol=1e-12)
    assert np.allclose(motor_torque(LOAD, arrives, velocity, 0.25), torque, rtol=1e-12, atol=1e-11)


def test_a_constant_torque_acts_at_rest():
    assert np.allclose(friction_torque(LOADED, np.zeros(3)), [0.3, -0.2, 0.0], rtol=1e-15)


def test_friction_that_drives_is_refused():
    check_friction(UNEVEN._replace(stribeck=(-0.1, 0.0, 0.0)))
    with pytest.raises(
        InputError, match=r'stribeck must be at least -friction.coulomb, -0.2, not'
    ):
        check_friction(UNEVEN._replace(stribeck=(0.0, -0.3, 0.0)))
