"""The axes against closed forms, with two of them and with five."""

from types import SimpleNamespace

import numpy as np
import pytest
from vectors import OnVectors, on_vectors

from parallel_robot_model.common.errors import InputError, RobotError
from parallel_robot_model.configuration.fields import build
from parallel_robot_model.robots import axes as module
from parallel_robot_model.robots.contract import FOUND, REACHED, PoseMotion, inverse_dynamics
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
)

axes = OnVectors(module)
INERTIA = (0.1, 0.25, 0.5, 0.15, 0.4)
COUNTS = pytest.mark.parametrize('n', [2, 5])
MARGINS = axes.SafetyMargins(0.1)
LIMITS = axes.MotionLimits(0.2)


def machine(n):
    """Axis i travels from -i to 2 i."""
    ends = tuple(float(i) for i in range(1, n + 1))
    return axes.Parameters(INERTIA[:n], tuple(-x for x in ends), tuple(2 * x for x in ends))


def row(n, seed=0):
    return np.random.default_rng(seed).uniform(-0.8, 0.8, n)


def estimate(robot, q, margins=MARGINS):
    return axes.estimate(robot, margins, np.array(q), row(len(q), 7), np.zeros(len(q)))


@COUNTS
def test_an_axis_for_each_inertia(n):
    robot = machine(n)
    assert axes.validate(robot) is robot
    assert axes.joints(robot) == n
    assert axes.coordinates(robot) == tuple((f'q{i + 1}', 'rad') for i in range(n))
    assert not axes.PLANAR and axes.segments(robot, row(n), row(n)) == {}


@COUNTS
def test_friction_and_disturbance_act_on_each_axis(n):
    viscous, coulomb, amplitude, phase = (np.abs(row(n, seed)) for seed in range(1, 5))
    load = JointLoad(
        FrictionParameters(
            tuple(viscous),
            tuple(coulomb),
            (0.0,) * len(viscous),
            0.01,
            0.0,
            *((0.0,) * len(viscous),) * 2,
        ),
        DisturbanceParameters(tuple(amplitude), 1.5, tuple(phase)),
    )
    robot, q, torque, t = machine(n), row(n), 10 * row(n, 6), 0.37
    qd = np.abs(row(n, 5)) * (-1.0) ** np.arange(n)  # both directions
    friction = viscous * qd + coulomb * np.sign(qd)
    delta = amplitude * np.sin(2 * np.pi * 1.5 * t + phase)
    expected = (torque - friction - delta) / np.array(INERTIA[:n])
    found = axes.acceleration(robot, load, q, qd, torque, t)
    assert np.allclose(found, expected, rtol=1e-13)


@COUNTS
def test_the_model_is_the_inertia_of_each_axis(n):
    found = estimate(machine(n), row(n))
    assert found.fault == FOUND and np.array_equal(found.pose, row(n))
    assert np.array_equal(found.model.M, np.diag(INERTIA[:n]))
    assert found.model.Q.shape == (n, n) and found.model.gravity.shape == (n,)
    assert not found.model.Q.any() and not found.model.gravity.any()
    torque = on_vectors(inverse_dynamics)(found.model, row(n, 1), row(n, 2))
    assert np.allclose(torque, np.array(INERTIA[:n]) * row(n, 1), rtol=1e-15)


@COUNTS
def test_joints_and_pose_are_one(n):
    robot, motion = machine(n), PoseMotion(row(n, 1), row(n, 2), row(n, 3))
    joints = axes.joint_motion(robot, motion)
    assert np.array_equal(joints[:3], motion)
    assert joints.passive.shape == (0,) and joints.out_of_reach == REACHED
    measured = axes.measure(robot, row(n, 1), row(n, 2))
    assert np.array_equal(measured.position, measured.pose)
    assert np.array_equal([measured.position, measured.velocity], [row(n, 1), row(n, 2)])
    assert measured.passive_position.shape == measured.passive_velocity.shape == (0,)
    location = axes.locate(robot, row(n, 1), np.zeros(n))
    assert location.fault == FOUND and np.array_equal(location.pose, row(n, 1))


def test_what_is_returned_does_not_change_with_what_was_given():
    q, qd = row(2), row(2, 1)
    measured = axes.measure(machine(2), q, qd)
    q[:], qd[:] = 9.0, 9.0
    assert np.array_equal(measured.position, row(2)) and np.array_equal(measured.pose, row(2))
    assert np.array_equal(measured.velocity, row(2, 1))


@COUNTS
@pytest.mark.parametrize(
    ('left', 'fault'), [(0.101, FOUND), (0.099, axes.END_OF_TRAVEL), (-1.0, axes.END_OF_TRAVEL)]
)
@pytest.mark.parametrize('end', ['lower', 'upper'])
def test_an_axis_near_an_end_of_its_travel_is_a_fault(n, left, fault, end):
    robot = machine(n)
    for i in range(n):
        q = np.zeros(n)
        q[i] = robot.lower[i] + left if end == 'lower' else robot.upper[i] - left
        found = estimate(robot, q)
        assert found.fault == fault
        assert np.array_equal(found.pose, q)
        assert found.model.M.any() == (fault == FOUND)
    assert axes.FAULTS[axes.END_OF_TRAVEL].key == 'end_of_travel'


def test_a_position_that_is_no_number_is_a_fault():
    assert estimate(machine(2), [0.0, np.nan]).fault == axes.END_OF_TRAVEL


@COUNTS
def test_the_start_lies_within_the_travel(n):
    robot = machine(n)
    for pose in (np.array(robot.lower), np.array(robot.upper)):
        assert np.array_equal(axes.start(robot, pose), pose)
    pose[-1] += 0.01
    reason = rf'plant\.initial_pose .* is out of reach of axis {n} \(.* -{n} to {2 * n} rad\)'
    with pytest.raises(InputError, match=reason):
        axes.start(robot, pose)


@COUNTS
def test_a_motion_to_the_end_of_travel_is_refused(n):
    robot = machine(n)
    position = np.zeros((50, n))
    position[:, -1] = np.linspace(0.0, -n, 50)
    assert axes.infeasible(robot, LIMITS, SimpleNamespace(position=position[:5])) == []
    (failure,) = axes.infeasible(robot, LIMITS, SimpleNamespace(position=position))
    expected = int(np.flatnonzero(position[:, -1] + n < 0.2)[0])
    assert (failure.sample, failure.part) == (expected, n)
    left = position[expected, -1] + n
    assert (
        failure.reason
        == f'end of travel, {left:.3g} rad left is below trajectory.min_travel, 0.2 rad'
    )


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'inertia': ()}, 'robot.inertia must hold at least one number'),
        ({'inertia': (0.1, 0.0)}, r'robot.inertia must be positive, not 0 \(axis 2\)'),
        ({'inertia': (np.nan, 0.1)}, r'robot.inertia must be positive, not nan \(axis 1\)'),
        ({'upper': (1.0,)}, 'robot.upper must hold 2 numbers like inertia, not 1'),
        (
            {'lower': (-1.0, 4.0)},
            r'robot.lower must be below robot.upper, not 4 and 4 rad \(axis 2\)',
        ),
    ],
)
def test_axes_that_cannot_be_built(change, message):
    with pytest.raises(RobotError, match=message):
        axes.validate(machine(2)._replace(**change))


def test_a_single_number_is_for_all_axes():
    values = {'inertia': [0.1, 0.2, 0.3], 'lower': -1, 'upper': 1.5}
    robot = build(axes.Parameters, values, 'robot.', 3)
    assert robot == ((0.1, 0.2, 0.3), (-1.0, -1.0, -1.0), (1.5, 1.5, 1.5))
