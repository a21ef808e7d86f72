"""Motions through points: splines against scipy's own and closed forms; files of points."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from parallel_robot import simulate
from parallel_robot.bags import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config, parameter_file
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.motion_doubts import motion_doubts
from trajectory_gen.waypoints import Parameters, motion, prepare

TIMES = np.array([0.0, 0.7, 1.1, 2.0, 3.5, 4.0, 5.2])
POINTS = np.random.default_rng(1).normal(size=(7, 2))
CLOSED = np.vstack([POINTS[:-1], POINTS[:1]])
REST = [(1, np.zeros(2)), (2, np.zeros(2))]
GOOD = 't, x, y, phi\n0, 0.52, 0.37, 1.57\n1, 0.5, 0.38, 1.57\n\n2, 0.49, 0.37, 1.57\n'


def spline(times, points, periodic=False, smoothing=0.0):
    return prepare(Parameters(tuple(times), tuple(np.ravel(points)), '', periodic, smoothing))


def sampled(made, grid):
    rows = [motion(made, t) for t in grid]
    return [np.array([getattr(row, name) for row in rows]) for name in rows[0]._fields]


@pytest.mark.parametrize('periodic', [False, True])
def test_the_spline_is_that_of_scipy(periodic):
    points = CLOSED if periodic else POINTS
    ends = 'periodic' if periodic else (REST, REST)
    theirs = make_interp_spline(TIMES, points, k=5, bc_type=ends)
    made, grid = spline(TIMES + 3.0, points, periodic), np.linspace(0.001, 5.199, 500)
    for order, ours in enumerate(sampled(made, grid)):
        assert np.abs(ours - theirs(grid, nu=order)).max() < 1e-9
    assert np.abs(sampled(made, TIMES[:-1])[0] - points[:-1]).max() < 1e-13


def test_two_points_are_joined_by_the_quintic_of_a_line():
    made, u = spline([0.0, 2.0], [[1.0, 5.0], [3.0, 4.0]]), np.linspace(0.0, 1.0, 50)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    expected = np.array([1.0, 5.0]) + s[:, np.newaxis] * [2.0, -1.0]
    assert np.abs(sampled(made, 2.0 * u)[0] - expected).max() < 1e-14


def test_it_rests_before_the_start_and_after_the_end_or_goes_on():
    rest = sampled(spline(TIMES, POINTS), [-1.0, 0.0, 5.2, 9.0])
    assert (rest[0][:2] == POINTS[0]).all() and np.allclose(rest[0][2:], POINTS[-1], atol=1e-13)
    assert not rest[1].any() and not rest[2].any()
    made = spline(TIMES, CLOSED, periodic=True)
    for first, later in zip(sampled(made, [0.3]), sampled(made, [0.3 + 5.2 * 7]), strict=True):
        assert np.abs(first - later).max() < 1e-9


@pytest.mark.parametrize('smoothing', [0.05, 0.2, 0.5])
def test_smoothing_filters_a_sine_as_it_says(smoothing):
    t = np.linspace(0.0, 2.0 * np.pi, 401)
    points = np.stack([np.sin(3.0 * t), np.cos(7.0 * t)], axis=1)
    points[-1] = points[0]
    smooth = sampled(spline(t, points, True, smoothing), t)[0]
    gain = 1.0 / (1.0 + (smoothing * np.array([3.0, 7.0])) ** 6)
    assert np.abs(smooth - gain * points).max() < 1e-4


def test_smoothing_goes_near_the_points_and_keeps_the_ends():
    t = np.linspace(0.0, 4.0, 201)
    noise = 1e-3 * np.random.default_rng(2).normal(size=t.size)
    u = t / 4.0
    true = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)  # at rest at both ends
    made = spline(t, true + noise, False, 0.1)
    found, rate, _ = (part[:, 0] for part in sampled(made, t))
    assert np.std(found - true) < 0.4 * np.std(noise)
    assert np.abs(rate - 7.5 * u**2 * (1.0 - u) ** 2).max() < 0.02
    assert np.allclose(found[[0, -1]], (true + noise)[[0, -1]], atol=1e-13)
    assert not rate[[0, -1]].any()


@pytest.mark.parametrize(
    ('times', 'points', 'periodic', 'message'),
    [
        ([0.0], [1.0], False, 'must hold from 2 to 5000 numbers, not 1'),
        ([0.0, 1.0], [1.0, 2.0, 3.0], False, 'one pose for each of the 2 times, not 3 numbers'),
        ([0.0, 1.0, 1.0], [1.0, 2.0, 3.0], False, '1 s is not after 1 s'),
        ([0.0, 1.0], [1.0, 2.0], True, r'equals the first, not \[2.0\] and \[1.0\]'),
        ([0.0, 1e-9, 1.0, 2.0], [1.0, 2.0, 0.0, 5.0], False, 'too uneven'),
    ],
)
def test_points_that_make_no_motion_are_refused(times, points, periodic, message):
    with pytest.raises(InputError, match=message):
        spline(times, points, periodic)


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    """Return a scenario whose points stand in a file beside it; it is called from elsewhere."""
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'points.csv').write_text(GOOD)
    path = tmp_path / 'mine' / 'own.yaml'
    path.write_text('base: paper_circle\nduration: 0.2\ntrajectory.shape: waypoints\n'
                    'waypoints.file: points.csv\n')  # fmt: skip
    monkeypatch.chdir(tmp_path)
    return path


def test_the_values_of_a_file_take_the_place_of_its_name(scenario):
    values = config.resolve(str(scenario))
    assert values['waypoints.file'] == '' and values['waypoints.times'] == [0.0, 1.0, 2.0]
    assert values['waypoints.points'][3:6] == [0.5, 0.38, 1.57]
    given = {'waypoints.file': 'mine/points.csv', 'trajectory.shape': 'waypoints'}
    assert config.resolve('paper_circle', given)['waypoints.times'] == [0.0, 1.0, 2.0]
    later = {'waypoints.times': [0.0, 2.0, 4.0]}
    assert trajectory_of(config.resolve(str(scenario), later)).span == 4.0


def test_many_points_are_not_all_shown(scenario, capsys):
    lines = [f'{k},0.5,0.37,1.57' for k in range(200)]
    (scenario.parent / 'points.csv').write_text('\n'.join(['t,x,y,phi', *lines]))
    assert main(['show', str(scenario)]) == 0
    assert '[0, 1, 2, ... 199] (200 in all)' in capsys.readouterr().out


def test_a_file_of_parameters_needs_no_file_of_points(scenario, capsys):
    assert main(['show', str(scenario), '--format', 'ros']) == 0
    (scenario.parent / 'all.yaml').write_text(capsys.readouterr().out)
    values = config.resolve(str(scenario))
    (scenario.parent / 'points.csv').unlink()
    again = config.resolve('paper_circle', {
        key: value for key, value in parameter_file.read(scenario.parent / 'all.yaml').items()
        if key != 'scenario'
    })  # fmt: skip
    assert {k for k in values if values[k] != again[k]} == {'scenario'}


def test_a_bag_runs_again_without_the_file(scenario, tmp_path, capsys):
    assert main(['simulate', str(scenario), '--out', 'bag']) == 0
    (scenario.parent / 'points.csv').unlink()
    assert main(['rerun', 'bag']) == 0
    assert 'identical' in capsys.readouterr().out
    reference = recording.read(tmp_path / 'bag').log.config['waypoints.points']
    assert reference[:3] == [0.52, 0.37, 1.57]


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'', 'line 1: the header must be t, x, y, phi'),
        (b'0, 0.5, 0.3, 0\n1, 0.5, 0.4, 0\n', "not '0, 0.5, 0.3, 0'"),
        (b't; x; y; phi\n', "not 't; x; y; phi'"),
        (b't, x, y, phi\n0, 0.5, nan, 0\n', "line 2: 'nan' is not a finite number"),
        (b't, x, y, phi\n0, 0.5, 1e999, 0\n', "line 2: '1e999' is not a finite number"),
        (b't, x, y, phi\n0, 0.5, 1_0, 0\n', "line 2: '1_0' is not a finite number"),
        (b't, x, y\n0, 0.5, left\n', "line 2: 'left' is not a finite number"),
        (b't, x, y\n0, 0.5\n', 'line 2 must hold 3 numbers, not 2'),
        (b't, x, y\n0, 0.5, 0.3\n2, 0.5, 0.3\n1, 0.5, 0.3\n', 'line 4: t = 1 is not after 2'),
        (b't, x, y\n0, 0.5, 0.3\n0.0, 0.5, 0.3\n', 'line 3: t = 0 is not after 0'),
        (b't, x, y\n0, 0.5, 0.3\n', 'must hold at least 2 points, not 1'),
        (b't,x\n' + b'1,1\n' * 300_000, 'has more than 1048576 bytes'),
        (b't,q1\n' + b''.join(b'%d,1\n' % k for k in range(5001)), 'has more than 5000 points'),
        (b'\x7fELF\x80\xff', 'is not a text in UTF-8'),
        (b't, x, y\n"0, 1\n' + b'a' * 200_000, 'field larger than field limit'),
        (None, 'is not a file'),
    ],
)  # fmt: skip
def test_a_wrong_file_costs_one_line(scenario, content, reason, capsys):
    file = scenario.parent / 'points.csv'
    file.unlink()
    file.mkdir() if content is None else file.write_bytes(content)
    assert main(['simulate', str(scenario), '--out', 'bag']) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and reason in error and 'own.yaml, line 4: ' in error
    assert not (scenario.parent.parent / 'bag').exists()


def test_a_missing_file_and_points_beside_a_file_cost_one_line(scenario, capsys):
    (scenario.parent / 'points.csv').unlink()
    assert main(['show', str(scenario)]) == 2
    assert 'points.csv does not exist' in capsys.readouterr().err
    words = ['--set', 'waypoints.file=a.csv', '--set', 'waypoints.points=[1.0]']
    assert main(['show', 'paper_circle', *words]) == 2
    assert 'waypoints.file and waypoints.points exclude' in capsys.readouterr().err


def test_points_of_another_robot_are_refused(scenario):
    changes = {'waypoints.file': 'mine/points.csv', 'trajectory.shape': 'waypoints'}
    with pytest.raises(InputError, match='waypoints has 3 coordinates; the pose of axes has 5'):
        trajectory_of(config.resolve('axes_step', changes))


def test_a_figure_of_eight_from_eight_points_is_as_exact_as_the_papers_circle():
    run = simulate('eight_waypoints')
    assert len(run.values['waypoints.times']) == 9  # the last is the first
    error = np.hypot(*run.pose_error[len(run.time) // 2 :, :2].T)
    assert np.sqrt(np.mean(error**2)) < 3e-6


@pytest.mark.parametrize(
    ('of', 'header', 'point'),
    [
        ('paper_circle', 't, q1, q2, q3', '0.52, 0.37, 1.57'),
        ('serial_2r_circle', 't, q1, q2', '0.5, 0.5'),
    ],
)
def test_joints_are_no_poses(scenario, of, header, point, capsys):
    """Columns say what they are: read as metres, those of joints would be another motion."""
    text = scenario.read_text().replace('paper_circle', of)
    scenario.write_text(text)
    (scenario.parent / 'points.csv').write_text(f'{header}\n0, {point}\n1, {point}\n')
    assert main(['simulate', str(scenario), '--out', 'bag']) == 2
    error = capsys.readouterr().err
    assert 'own.yaml, line 4: waypoints.file: columns q1, q2' in error and 'x [m], y [m]' in error
    scenario.write_text(text.replace('shape: waypoints', 'shape: circle'))
    assert config.resolve(str(scenario))['waypoints.points'] and trajectory_of(
        config.resolve(str(scenario))
    )  # which nobody follows


def test_numbers_of_other_units_are_doubted(scenario):
    def doubts(of, times=(0.0, 1.0), angle=1.57, **changes):
        points = [0.5, 0.37, angle, 0.51, 0.37, angle]
        changes = {'waypoints.times': [*times], 'waypoints.points': points, **changes}
        values = {'trajectory.shape': 'waypoints', **changes}
        return motion_doubts(trajectory_of(config.resolve(of, values)))

    assert doubts('paper_circle') == ()
    (degrees,) = doubts('paper_circle', angle=90.0)
    assert 'phi reaches 90 rad, 14.3 turns' in degrees and 'must be 1.571 rad' in degrees
    (nanoseconds,) = doubts('paper_circle', (0.0, 6e9))
    assert 'last 6e+09 s: if they are in ns' in nanoseconds and 'to last 6 s' in nanoseconds
    (dropped,) = doubts('serial_2r_circle')
    assert 'phi, which is not used: the pose of serial_2r is x, y' in dropped
    circle = {'trajectory.shape': 'circle', 'circle.phi': -90.0}
    (degrees,) = motion_doubts(trajectory_of(config.resolve('paper_circle', circle)))
    assert 'circle: phi reaches -90 rad' in degrees
