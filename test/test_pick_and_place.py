"""The motion between two points that is lifted on the way."""

import numpy as np
import pytest

from parallel_robot_model.common.errors import InputError
from trajectory_gen import pick_and_place
from trajectory_gen.configuration import resolve, trajectory_of
from trajectory_gen.pick_and_place import Parameters

IN_SPACE = Parameters(
    (0.1, 0.0, -1.0, 0.0, 0.0, 0.1), (-0.1, 0.2, -1.0, 0.0, 0.0, 0.4), 0.05, (), 0.8, 0.2, 0.1, 0.0
)


def sampled(way, times):
    return [
        np.array(part)
        for part in zip(*(pick_and_place.motion(way, t) for t in times), strict=True)
    ]


def test_it_goes_there_and_back_and_rests_at_both_points():
    way = pick_and_place.prepare(IN_SPACE)
    pose, rate, acceleration = sampled(way, [0.0, 0.8, 0.85, 0.9, 1.7, 1.75, 1.8])
    np.testing.assert_allclose(pose[[0, 4, 5, 6]], [IN_SPACE.pick] * 4, atol=1e-12)
    np.testing.assert_allclose(pose[1:4], [IN_SPACE.place] * 3, atol=1e-12)
    assert np.abs(rate).max() < 1e-12 and np.abs(acceleration).max() < 1e-9
    assert pick_and_place.span(way) == pytest.approx(1.8)


def test_it_is_at_full_height_in_the_middle_and_never_above():
    way = pick_and_place.prepare(IN_SPACE)
    pose = sampled(way, np.linspace(0.0, 0.8, 801))[0]
    assert pose[400, 2] == pytest.approx(-0.95, abs=1e-12) and pose[:, 2].max() <= -0.95 + 1e-12
    under_way = np.abs(pose[:, 0]) < 0.1 - 1e-12
    assert pose[under_way, 2].min() >= -1.0 + 0.025 - 1e-6  # at least half of the height


def test_its_derivatives_are_those_of_finite_differences():
    way, step = pick_and_place.prepare(IN_SPACE), 1e-6
    times = np.linspace(0.01, 3.5, 700)
    _, rate, acceleration = sampled(way, times)
    ahead, behind = sampled(way, times + step), sampled(way, times - step)
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * step), rate, atol=1e-8)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * step), acceleration, atol=1e-3)
    fine = sampled(way, np.linspace(0.0, 3.6, 7201))[2]
    assert np.abs(np.diff(fine, axis=0)).max() < 0.2  # of 7 m/s^2: it does not jump


def test_in_a_plane_up_is_y_and_the_angle_is_kept():
    made = Parameters((0.46, 0.37), (0.52, 0.37), 0.03, (), 1.0, 0.3, 0.0, 1.5)
    pose = sampled(pick_and_place.prepare(made), [0.0, 0.5, 1.0])[0]
    np.testing.assert_allclose(pose, [[0.46, 0.37, 1.5], [0.49, 0.40, 1.5], [0.52, 0.37, 1.5]])


def test_another_direction():
    way = pick_and_place.prepare(IN_SPACE._replace(direction=(0.0, 3.0, 4.0)))
    np.testing.assert_allclose(way.lift, [0.0, 0.03, 0.04, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({'pick': (0.1,)}, 'must be [x, y] both, or poses that begin with x, y, z'),
        ({'place': (0.1, 0.2)}, 'must be [x, y] both, or poses that begin with x, y, z'),
        ({'direction': (0.0, 0.0, 0.0)}, 'must be [] or 3 numbers, not all zero'),
        ({'direction': (0.0, 1.0)}, 'must be [] or 3 numbers, not all zero'),
        ({'rise': 0.5}, 'at most half of the duration, 0.4 s, not 0.5'),
    ],
)
def test_what_it_refuses(changes, text):
    with pytest.raises(InputError) as refused:
        pick_and_place.prepare(IN_SPACE._replace(**changes))
    assert text in str(refused.value)


@pytest.mark.parametrize('scenario', ['paper_circle', 'serial_2r_circle'])
def test_robots_in_a_plane_perform_it(scenario):
    trajectory = trajectory_of(resolve(scenario, {'trajectory.shape': 'pick_and_place'}))
    reference = trajectory.sample(np.linspace(0.0, trajectory.span, 500))
    assert (reference.out_of_reach < 0).all() and trajectory.end is None
