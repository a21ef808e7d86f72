"""Motions against closed forms; every derivative against central differences."""

import numpy as np
import pytest
from geometry import closure, legs, wrap

from parallel_robot_base import config
from parallel_robot_base.errors import InputError
from trajectory_gen.trajectory import Trajectory

SCENARIOS = ['paper_circle', 'circle_pi12', 'paper_line', 'excitation']


def trajectory(scenario='paper_circle', **changes):
    return Trajectory(config.resolve(scenario, changes.get('overrides')))


@pytest.fixture(params=SCENARIOS)
def motion(request):
    return trajectory(request.param)


def central(motion, t, field, h=1e-4):
    """Derivative of a field at the times `t` by a central difference of order 4."""
    near, far = (
        wrap(getattr(motion.sample(t + k * h), field) - getattr(motion.sample(t - k * h), field))
        / (2 * k * h)
        for k in (1, 2)
    )
    return (4 * near - far) / 3


@pytest.mark.parametrize(
    ('field', 'derivative'),
    [
        ('pose', 'pose_rate'),
        ('pose_rate', 'pose_acceleration'),
        ('position', 'velocity'),
        ('velocity', 'acceleration'),
    ],
)
def test_derivatives(motion, field, derivative):
    t = np.linspace(0.01, 5.99, 200)
    found = getattr(motion.sample(t), derivative)
    assert np.abs(found).max() > 1e-3
    assert np.abs(found - central(motion, t, field)).max() < 1e-8


def test_joints_stand_as_the_pose_needs(motion, robot):
    reference = motion.sample(np.linspace(0, 6, 100))
    gaps = closure(robot, reference.pose, reference.position, reference.passive)
    assert gaps.max() < 1e-12 and (reference.out_of_reach == -1).all()
    assert np.abs(wrap(reference.position - legs(robot, reference.pose)[0])).max() < 1e-12


@pytest.mark.parametrize(('scenario', 'phi'), [('paper_circle', 2), ('circle_pi12', 12)])
def test_the_papers_circle(scenario, phi):
    t = np.linspace(0, 12, 500)
    x, y, angle = trajectory(scenario).sample(t).pose.T
    assert np.abs(x - (0.49 + 0.03 * np.cos(np.pi * t / 3))).max() < 1e-15
    assert np.abs(y - (0.37 + 0.03 * np.sin(np.pi * t / 3))).max() < 1e-15
    assert (angle == np.pi / phi).all()


def test_the_line_is_straight_and_at_rest_at_both_ends():
    line = trajectory('paper_line')
    for t, point in ((0.0, (0.52, 0.37)), (6.0, (0.46, 0.41)), (100.0, (0.46, 0.41))):
        at = line.sample(t)
        assert np.allclose(at.pose[0], [*point, np.pi / 2], atol=1e-15)
        for rest in (at.pose_rate, at.pose_acceleration, at.velocity, at.acceleration):
            assert np.abs(rest).max() < 1e-14
    x, y, _ = line.sample(np.linspace(0, 6, 100)).pose.T
    assert np.abs((x - 0.52) * 0.04 + (y - 0.37) * 0.06).max() < 1e-16
    assert (np.diff(x) < 0).all()
    assert np.allclose(line.sample(3.0).pose[0, :2], [0.49, 0.39], atol=1e-15)


def test_nothing_jumps_where_the_line_begins_and_ends():
    line = trajectory('paper_line')
    for corner in (0.0, 6.0):
        around = line.sample(corner + np.array([-1e-6, 1e-6]))
        for value in (around.pose, around.pose_rate, around.pose_acceleration):
            assert np.abs(np.diff(value, axis=0)).max() < 1e-7


def test_an_excitation_goes_from_rest_to_rest_at_its_centre():
    motion = trajectory('excitation')
    for t in (0.0, 15.0, 100.0):
        at = motion.sample(t)
        assert np.allclose(at.pose[0], [0.5, 0.29, 0.0], atol=1e-12)
        for rest in (at.pose_rate, at.pose_acceleration, at.velocity, at.acceleration):
            assert np.abs(rest).max() < 1e-10
    assert motion.span == 15.0
    # Between rise and fall it repeats itself, and is the Fourier series itself.
    first, second = motion.sample(2.0).pose, motion.sample(5.0).pose
    assert np.allclose(first, second, atol=1e-12)
    overrides = {'excitation.sine': [0.01, 0.0, 0.02] + [0.0] * 6, 'excitation.cosine': [0.0] * 9}
    x = trajectory('excitation', overrides=overrides).sample(2.2).pose[0, 0]
    w = 2.0 * np.pi * 2.2 / 3.0
    assert abs(x - 0.5 - 0.01 * np.sin(w) - 0.02 * np.sin(3.0 * w)) < 1e-12


@pytest.mark.parametrize(
    ('overrides', 'message'),
    [
        ({'excitation.sine': [0.1] * 4}, 'must hold K numbers for each of the 3 coordinates'),
        ({'excitation.center': []}, 'excitation.center must hold at least one number'),
        ({'excitation.blend': 8.0}, 'excitation.blend must be at most half'),
    ],
)
def test_an_excitation_that_is_none_is_refused(overrides, message):
    with pytest.raises(InputError, match=message):
        trajectory('excitation', overrides=overrides)


def test_a_held_pose_stays():
    overrides = {'trajectory.shape': 'hold', 'hold.pose': [0.5, 0.3, 0.2]}
    reference = trajectory(overrides=overrides).sample([0.0, 1.0, 1e6])
    assert (reference.pose == [0.5, 0.3, 0.2]).all()
    assert not reference.velocity.any() and not reference.acceleration.any()


@pytest.mark.parametrize(
    ('overrides', 'span'),
    [
        ({}, 6.0),
        ({'circle.rate': -2.0}, np.pi),
        ({'circle.rate': 0.0}, 0.0),
        ({'trajectory.shape': 'line', 'line.duration': 2.5}, 2.5),
        ({'trajectory.shape': 'hold'}, 0.0),
    ],
)
def test_span_is_when_everything_was_shown(overrides, span):
    assert abs(trajectory(overrides=overrides).span - span) < 1e-12


def test_out_of_reach_is_marked_with_the_leg_and_nan(robot):
    overrides = {'trajectory.shape': 'line', 'line.end': [1.6, 0.37]}
    reference = trajectory(overrides=overrides).sample(np.linspace(0, 6, 61))
    lost = np.isnan(legs(robot, reference.pose)[0])
    assert lost.any() and not lost.all()
    first = np.where(lost.any(axis=1), lost.argmax(axis=1), -1)
    assert np.array_equal(reference.out_of_reach, first)
    assert np.array_equal(np.isnan(reference.position), lost)


def test_a_number_and_a_row_of_times_agree(motion):
    t = np.linspace(0, 6, 7)
    row = motion.sample(t)
    for k in range(7):
        for whole, one in zip(row, motion.sample(t[k]), strict=True):
            assert np.array_equal(whole[k], one[0])
