"""The motion changed by parameters while the node runs: continuous, as asked for, or refused."""

from pathlib import Path

import numpy as np
import pytest
from trajectory_run import Run, smooth

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from trajectory_gen import preflight
from trajectory_gen.configuration import changed, motions_of, resolve, trajectory_of
from trajectory_gen.shapes import SHAPES
from trajectory_gen.trajectory import MotionSequence

pytest_plugins = ['ros_fixtures']

TRANSITION = 2000  # samples
REST = [0.52, 0.37, 0.5 * np.pi]
WAY = [*REST, 0.5, 0.38, 1.5, *REST]
CHANGES = {
    'radius': {'circle__radius': 0.02},
    'two at once': {'circle__radius': 0.04, 'circle__center': [0.5, 0.36]},
    'rate': {'circle__rate': 0.5},
    'faster': {'trajectory__speed_factor': 1.5},
    'ellipse': {'trajectory__shape': 'ellipse'},
    'line': {'trajectory__shape': 'line', 'line__duration': 3.0},
    'hold': {'trajectory__shape': 'hold', 'hold__pose': [0.5, 0.36, 1.4]},
    'excitation': {'trajectory__shape': 'excitation', 'excitation__amplitude': 0.5},
    'waypoints': {
        'trajectory__shape': 'waypoints',
        'waypoints__times': [0.0, 1.0, 3.0],
        'waypoints__points': WAY,
    },
}


def planned(**changes):
    """The motion that a node would have from the start."""
    values = {key.replace('__', '.'): value for key, value in changes.items()}
    return trajectory_of(config.resolve('paper_circle', values))


@pytest.mark.parametrize('name', CHANGES)
def test_a_change_is_continuous_and_ends_in_the_motion_asked_for(name, node):
    run, changes = Run(node), CHANGES[name]
    run.go(700)
    assert not run.set(**changes)
    run.go(TRANSITION + 4500)
    k, *motion = heard = run.heard()
    smooth(*heard)
    text, begin = run.told
    assert text.endswith(', in 2 s') and 700 <= begin <= 1000
    before, after = planned(), planned(**changes)
    np.testing.assert_array_equal(
        motion[0][: begin + 1], before.sample(k[: begin + 1] * 1e-3).position
    )
    times = np.arange(TRANSITION, TRANSITION + 4000) * 1e-3
    if after.parameters.shape == 'circle':  # at the same share of the turn
        times += begin * 1e-3 / before.span * after.span
    elif not after.sample(0.0).pose_rate.any():  # it waits for the end of the transition
        times -= TRANSITION * 1e-3
    found = [field[begin + TRANSITION :][:4000] for field in motion]
    wanted = after.sample(times)
    for got, field in zip(found, ('position', 'velocity', 'acceleration'), strict=True):
        np.testing.assert_allclose(got, getattr(wanted, field), atol=1e-8)


def test_the_difference_fades_by_a_quintic_polynomial():
    """Between two motions at rest, that is the polynomial of the shape `move`."""
    here, there = [0.5, 0.36, 1.4], [0.47, 0.38, 1.6]
    course = MotionSequence(planned(trajectory__shape='hold', hold__pose=here), 1e-3)
    wanted = {'trajectory.shape': 'hold', 'hold.pose': there}
    found = preflight.transition_to(course, 5, motions_of(resolve('paper_circle', wanted)))
    move = planned(trajectory__shape='move', move__start=here, move__end=there, move__duration=2.0)
    times = np.arange(1, 2500)
    for got, wanted in zip(found.sample(times + 5), move.sample(times * 1e-3), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_changes_may_follow_each_other_before_the_transition_is_over(node):
    run = Run(node)
    run.go(100)
    for k in range(12):
        assert not run.set(circle__radius=0.03 - 0.001 * k)
        run.go(130)
        if k % 4 == 3:
            assert not run.set(trajectory__shape=('line', 'circle', 'hold')[k // 4])
            run.go(130)
    assert not run.set(trajectory__shape='circle', trajectory__transition=0.5)
    run.go(3000)
    k, position, *_ = heard = run.heard()
    smooth(*heard)
    _, begin = run.told
    wanted = planned(circle__radius=0.019).sample((k[begin + 500 :] - begin) * 1e-3)
    np.testing.assert_allclose(position[begin + 500 :], wanted.position, atol=1e-9)


def test_a_motion_that_has_come_to_rest_is_performed_anew(node):
    run = Run(node)
    run.go(100)
    assert not run.set(trajectory__shape='line', line__duration=1.0, trajectory__transition=0.5)
    run.go(2000)
    assert not run.set(line__end=[0.5, 0.39])
    run.go(3000)
    k, position, *_ = heard = run.heard()
    smooth(*heard)
    _, begin = run.told
    line = planned(trajectory__shape='line', line__duration=1.0, line__end=[0.5, 0.39])
    wanted = line.sample((k[begin + 500 :] - begin - 500) * 1e-3)
    np.testing.assert_allclose(position[begin + 500 :], wanted.position, atol=1e-9)


def test_what_does_not_change_the_motion_is_stored_and_no_more(node):
    run = Run(node)
    assert not run.set(line__duration=2.0)  # even before it has begun
    run.go(500)
    before = run.node._sequence
    assert not run.set(line__duration=1.0, trajectory__transition=1.0, circle__radius=0.03)
    assert not run.set(trajectory__shape='circle')
    assert run.node._sequence is before and not run.node.has_parameter('granted.motion')
    assert run.node.get_parameter('line.duration').value == 1.0
    assert not run.set(circle__radius=0.02)
    assert run.told[0].endswith('in 1 s')


FAR = 'motion refused at t = '
REFUSED = {
    'too large': ({'circle__radius': 0.5}, FAR),
    'too far': ({'circle__center': [3.0, 3.0]}, FAR),
    'too fast': ({'circle__rate': 1e4}, FAR),
    'in too short a time': (
        {'circle__center': [0.52, 0.4], 'trajectory__transition': 0.01},
        'above trajectory.max_joint_speed',
    ),
    'a limit': ({'trajectory__max_joint_speed': 1e-3}, 'above trajectory.max_joint_speed, 0.001'),
    'NaN': ({'circle__radius': float('nan')}, 'circle.radius must be finite, not nan'),
    'infinite': ({'circle__rate': float('-inf')}, 'circle.rate must be finite, not -inf'),
    'NaN in a list': (
        {'trajectory__shape': 'hold', 'hold__pose': [0.5, float('nan'), 1.5]},
        'hold.pose[1] must be finite, not nan',
    ),
    'text': ({'circle__radius': 'wide'}, "circle.radius must be a number, not 'wide'"),
    'a list': ({'circle__radius': [0.03, 0.03]}, 'circle.radius must be a number, not'),
    'a number': ({'circle__center': 0.5}, 'circle.center must be a list of numbers, not 0.5'),
    'texts': ({'hold__pose': ['a']}, "hold.pose[0] must be a number, not 'a'"),
    'negative': ({'circle__radius': -0.03}, 'circle.radius must be at least 0 m, not -0.03'),
    'no time': ({'trajectory__transition': 0.0}, 'trajectory.transition must be from 0.01 to'),
    'unknown shape': ({'trajectory__shape': 'cirlce'}, "unknown trajectory.shape 'cirlce'; did"),
    'unknown key': ({'circle__radios': 0.02}, "did you mean 'circle.radius'?"),
    'no points': ({'trajectory__shape': 'waypoints'}, 'waypoints.times must hold from 2 to'),
    'short': ({'trajectory__shape': 'hold', 'hold__pose': [0.5]}, 'hold has 1 coordinates; the'),
    'long': ({'trajectory__shape': 'hold', 'hold__pose': [0.5] * 900}, 'has 900 coordinates'),
    'odd': (
        {
            'trajectory__shape': 'waypoints',
            'waypoints__times': [0.0, 1.0],
            'waypoints__points': WAY[:-2],
        },
        'waypoints.points must hold one pose for each of the 2 times, not 7 numbers',
    ),
    'half good': ({'circle__radius': 0.02, 'line__duration': 0.0}, 'line.duration must be at'),
    'fixed': ({'circle__radius': 0.02, 'trajectory__lookahead': 0.1}, 'lookahead is fixed at'),
    'a file': ({'waypoints__file': '/etc/passwd'}, 'waypoints.file is fixed at the start'),
    'a start': ({'circle__radius': 0.02, 'start_stamp': 5}, 'start_stamp is set in a request of'),
}  # fmt: skip


@pytest.mark.parametrize('node', ['lockstep'], indirect=True)
def test_what_is_wrong_is_refused_in_one_line_and_changes_nothing(node):
    run = Run(node)
    assert 'the motion has not begun' in run.set(circle__radius=0.02)
    run.go(100)
    before, parameters = run.node._sequence, run.node.get_parameters_by_prefix('')
    known = {key: parameter.value for key, parameter in parameters.items()}
    for name, (changes, reason) in REFUSED.items():
        refused = run.set(**changes)
        assert reason in refused and len(refused) < 400, (name, refused)
        assert run.node._sequence is before
        parameters = run.node.get_parameters_by_prefix('')
        assert known == {key: parameter.value for key, parameter in parameters.items()}, name
    assert not run.node.counts and not run.set(circle__radius=0.02)


@pytest.mark.parametrize('node', ['lockstep'], indirect=True)
def test_a_thousand_points_are_taken(node):
    run, count = Run(node), 1300
    run.go(10)
    times = np.linspace(0.0, 8.0, count)
    turn = 2 * np.pi * (times / 8) ** 3 * (10 - 15 * (times / 8) + 6 * (times / 8) ** 2)
    poses = np.array(REST) + 0.01 * np.stack([np.cos(turn) - 1, np.sin(turn), 0 * turn], axis=1)
    points = {'waypoints__times': times.tolist(), 'waypoints__points': poses.ravel().tolist()}
    assert not run.set(trajectory__shape='waypoints', **points)
    run.go(11_000)
    _, position, *_ = heard = run.heard()
    smooth(*heard)
    _, begin = run.told
    wanted = planned(trajectory__shape='hold', hold__pose=poses[400].tolist()).sample(0.0)
    at = begin + TRANSITION + times[400] * 1e3
    between = position[int(at)] + (at % 1) * (position[int(at) + 1] - position[int(at)])
    np.testing.assert_allclose(between, wanted.position[0], atol=1e-6)


@pytest.mark.parametrize('node', ['lockstep'], indirect=True)
def test_a_change_compiles_nothing(node, monkeypatch):
    from numba.core import compiler

    run = Run(node)
    run.go(10)
    monkeypatch.setattr(compiler, 'compile_extra', None)
    for name in [*SHAPES, 'circle']:
        more = {'waypoints__times': [0.0, 5.0, 9.0], 'waypoints__points': WAY}
        poses = {'trapezoid__start': WAY[:3], 'trapezoid__end': WAY[3:6]}
        assert not run.set(trajectory__shape=name, **(more if name == 'waypoints' else poses))
        run.go(100)
    assert not run.set(trajectory__shape='excitation', excitation__sine=[1e-3] * 3,
                       excitation__cosine=[0.0] * 3)  # fmt: skip


OF_OTHERS = {
    'serial_2r_circle': ({'circle.radius': 0.1}, {'trajectory.shape': 'figure_eight'}),
    'axes_step': (
        {'trajectory.shape': 'hold', 'hold.pose': [0.02, 0.01, 0.0, 0.03, 0.01]},
        {'hold.pose': [0.01, 0.02, 0.0, 0.0, 0.0]},
    ),
}


@pytest.mark.parametrize('node', [f'lockstep {name}' for name in OF_OTHERS], indirect=True)
def test_any_robot_has_its_motions_changed(node):
    run = Run(node)
    run.go(300)
    for changes in OF_OTHERS[run.node.loop.scenario]:
        assert not run.set(**{key.replace('.', '__'): value for key, value in changes.items()})
        run.go(1300)
    k, position, velocity, acceleration = run.heard()
    _, begin = run.told
    late = slice(begin - 1200, None)  # the motion that a scenario begins with may jump
    smooth(k[late], position[late], velocity[late], acceleration[late])


@pytest.mark.parametrize('node', ['lockstep axes_step'], indirect=True)
def test_a_shape_for_a_robot_of_another_kind_is_refused(node):
    run = Run(node)
    run.go(10)
    assert 'circle has 3 coordinates; the pose of axes has' in run.set(trajectory__shape='circle')


def test_lists_of_a_custom_trajectory_keep_their_lengths():
    """Its kernel is compiled for them, which would hold up a loop that runs."""
    path = str(Path(__file__).parents[1] / 'docs/example_trajectory.py')
    values = resolve('paper_circle', {'custom_trajectories': [path]})
    motions = motions_of(values)
    shape = {'trajectory.shape': 'example_trajectory'}
    made = changed(motions, {**values, **shape, 'example_trajectory.size': [0.01, 0.02, 0.0]})
    assert made.trajectory.span == 12.0
    with pytest.raises(InputError, match='lists of example_trajectory keep their lengths'):
        changed(motions, {**values, **shape, 'example_trajectory.size': [0.01, 0.02]})


def test_a_motion_changed_to_hold_comes_to_rest_where_it_was(node):
    run = Run(node)
    run.go(700)
    assert not run.set(trajectory__shape='hold')
    run.go(TRANSITION + 1000)
    _, position, *_ = heard = run.heard()
    smooth(*heard)
    _, begin = run.told
    there, rest = planned().sample(begin * 1e-3).position[0], position[begin + TRANSITION :]
    np.testing.assert_allclose(rest, np.tile(there, (len(rest), 1)), atol=1e-9)
    assert not run.set(trajectory__shape='circle')
    run.go(TRANSITION + 1000)
    assert not run.set(trajectory__shape='hold')  # anew, and elsewhere
    run.go(TRANSITION + 1000)
    _, position, *_ = heard = run.heard()
    smooth(*heard)
    assert np.abs(position[-1] - there).max() > 1e-3
