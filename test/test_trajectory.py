"""Motions against closed forms; every derivative against central differences."""

import numpy as np
import pytest
from geometry import closure, legs, wrap

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from trajectory_gen.configuration import trajectory_of

SCENARIOS = ['paper_circle', 'circle_pi12', 'paper_line', 'excitation']
SMOOTH = {  # shapes without a scenario of their own
    'ellipse': {'ellipse.angle': 0.4},
    'figure_eight': {'figure_eight.angle': -0.3},
}


def trajectory(scenario='paper_circle', **changes):
    return trajectory_of(config.resolve(scenario, changes.get('overrides')))


def shaped(shape, **changes):
    """Return a motion of a shape; changes are keys of its group."""
    overrides = {f'{shape}.{key}': value for key, value in changes.items()}
    return trajectory(overrides={'trajectory.shape': shape, **overrides})


@pytest.fixture(params=[*SCENARIOS, *SMOOTH])
def motion(request):
    if request.param in SMOOTH:
        return trajectory(overrides={'trajectory.shape': request.param, **SMOOTH[request.param]})
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


def test_an_ellipse_meets_its_equation_and_turns_once_in_its_span():
    motion = shaped('ellipse', semi_axes=[0.04, 0.02], angle=0.4, rate=-1.3, center=[0.5, 0.36])
    x, y, phi = motion.sample(np.linspace(0.0, motion.span, 300)).pose.T - [[0.5], [0.36], [0.0]]
    u, v = x * np.cos(0.4) + y * np.sin(0.4), y * np.cos(0.4) - x * np.sin(0.4)
    assert np.abs((u / 0.04) ** 2 + (v / 0.02) ** 2 - 1.0).max() < 1e-12
    assert abs(np.unwrap(np.arctan2(v / 0.02, u / 0.04))[-1] + 2.0 * np.pi) < 1e-9
    assert (phi == np.pi / 2).all()


def test_an_ellipse_with_equal_axes_is_the_circle():
    t = np.linspace(0.0, 6.0, 50)
    ours = shaped('ellipse', semi_axes=[0.03, 0.03]).sample(t)
    for a, b in zip(ours, trajectory().sample(t), strict=True):
        assert np.abs(a - b).max() < 1e-14


def test_a_figure_of_eight_meets_its_equation_and_crosses_at_its_centre():
    motion = shaped('figure_eight', length=0.06, width=0.05, angle=0.7, rate=2.0)
    t = np.linspace(0.0, motion.span, 401)
    x, y, _ = motion.sample(t).pose.T - [[0.49], [0.37], [0.0]]
    u, v = x * np.cos(0.7) + y * np.sin(0.7), y * np.cos(0.7) - x * np.sin(0.7)
    c = u / 0.03  # Gerono: v^2 = width^2 c^2 (1 - c^2)
    assert np.abs(v**2 - 0.05**2 * c**2 * (1.0 - c**2)).max() < 1e-15
    crossings = np.hypot(x, y)[[100, 300]]
    assert (
        crossings.max() < 1e-15 and abs(np.ptp(v) - 0.05) < 1e-5 and abs(np.ptp(u) - 0.06) < 1e-15
    )


@pytest.mark.parametrize(
    ('way', 'acceleration', 'end'),
    [(0.3, 0.5, 0.3 / 0.1 + 0.1 / 0.5), (-0.01, 0.5, 2.0 * np.sqrt(0.01 / 0.5))],
    ids=['with a constant rate', 'too short for one'],
)
def test_a_trapezoid_takes_the_time_of_the_textbook_and_keeps_its_limits(way, acceleration, end):
    motion = shaped(
        'trapezoid', start=[0.4, 0.37, 1.57], end=[0.4 + way, 0.37, 1.57],
        speed=[0.1, 1.0, 1.0], acceleration=[acceleration, 1.0, 1.0],
    )  # fmt: skip
    assert abs(motion.span - end) < 1e-12
    t = np.linspace(-0.1, end + 0.1, 40001)
    made = motion.sample(t)
    x, rate, second = made.pose[:, 0], made.pose_rate[:, 0], made.pose_acceleration[:, 0]
    assert (x[0], x[-1], rate[0], rate[-1]) == (0.4, 0.4 + way, 0.0, 0.0)
    assert np.abs(rate).max() <= 0.1 * (1 + 1e-12) and np.abs(second).max() <= acceleration
    assert np.abs(np.gradient(x, t) - rate).max() < 1e-4
    assert np.abs(np.cumsum(second) * (t[1] - t[0]) - rate).max() < 1e-4
    assert set(np.round(np.abs(second), 9)) <= {0.0, acceleration}


def test_a_trapezoid_moves_all_coordinates_in_step_and_may_stand_still():
    motion = trajectory_of(config.resolve('axes_step', {
        'trajectory.shape': 'trapezoid', 'trapezoid.end': [1.0, -0.5, 0.25, 0.0, 1.5],
        'trapezoid.speed': [1.0, 0.25, 1.0, 1.0, 9.0], 'trapezoid.acceleration': [9.0] * 5,
    }))  # fmt: skip
    made = motion.sample(np.linspace(0.0, motion.span, 500))
    assert np.allclose(made.pose, made.pose[:, :1] * [1.0, -0.5, 0.25, 0.0, 1.5], atol=1e-15)
    assert np.isclose(np.abs(made.pose_rate[:, 1]).max(), 0.25)  # the tightest limit is reached
    still = shaped('trapezoid', end=[0.52, 0.37, np.pi / 2])
    assert still.span == 0.0 and not still.sample([0.0, 1.0]).velocity.any()


@pytest.mark.parametrize(
    ('scenario', 'overrides', 'message'),
    [
        ('paper_circle', {'trapezoid.speed': [0.1]}, '3, 3, 1 and 3'),
        ('paper_circle', {'trapezoid.speed': [0.1, 0.1, 0.0]}, 'must be at least 1e-06, not 0'),
        ('paper_circle', {'ellipse.semi_axes': [0.1, -0.1]}, 'must be at least 0 m, not -0.1'),
        ('axes_step', {'trajectory.shape': 'figure_eight'}, 'has 3 coordinates; the pose of axes'),
        ('axes_step', {'trajectory.shape': 'ellipse'}, 'has 3 coordinates; the pose of axes'),
    ],
)
def test_a_shape_with_wrong_numbers_or_of_another_robot_is_refused(scenario, overrides, message):
    shape = next(iter(overrides)).partition('.')[0]
    chosen = {} if shape == 'trajectory' else {'trajectory.shape': shape}
    with pytest.raises(InputError, match=message):
        trajectory_of(config.resolve(scenario, chosen | overrides))


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


def test_without_a_pose_hold_takes_that_in_which_the_robot_is():
    overrides = {'trajectory.shape': 'hold', 'plant.initial_pose': [0.5, 0.3, 0.2]}
    reference = trajectory(overrides=overrides).sample([0.0, 1.0])
    assert (reference.pose == [0.5, 0.3, 0.2]).all() and not reference.velocity.any()
    reason = r'plant\.initial_pose must be \[x, y, phi\], not \[0\.5, 0\.3\]'
    with pytest.raises(InputError, match=reason):
        trajectory(overrides={**overrides, 'plant.initial_pose': [0.5, 0.3]})
    trajectory(overrides={'plant.initial_pose': [0.5, 0.3]})  # of no concern to other motions
