"""Motions through points: splines against scipy's own and closed forms; files of points."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from parallel_robot import simulate
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config, yaml_file
from parallel_robot_model.configuration import points as points_table
from trajectory_gen import joint_path
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.preflight import motion_warnings
from trajectory_gen.waypoints import Parameters, motion, prepare

TIMES = np.array([0.0, 0.7, 1.1, 2.0, 3.5, 4.0, 5.2])
POINTS = np.random.default_rng(1).normal(size=(7, 2))
CLOSED = np.vstack([POINTS[:-1], POINTS[:1]])
OWN = {'file': '', 'columns': (), 'units': (), 'thinned': '', 'space': 'pose'}
REST = [(1, np.zeros(2)), (2, np.zeros(2))]
GOOD = 't, x, y, phi\n0, 0.52, 0.37, 1.57\n1, 0.5, 0.38, 1.57\n\n2, 0.49, 0.37, 1.57\n'


def spline(times, points, periodic=False, smoothing=0.0):
    values = {'times': tuple(times), 'points': tuple(np.ravel(points))}
    return prepare(Parameters(**OWN | values, periodic=periodic, smoothing=smoothing))


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
    shown = yaml_file.read_parameter_file(scenario.parent / 'all.yaml')
    again = config.resolve('paper_circle', {k: v for k, v in shown.items() if k != 'scenario'})
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
        (b'', 'points.csv is empty'),
        (b'0, 0.5, 0.3, 0\n1, 0.5, 0.4, 0\n', "not '0, 0.5, 0.3, 0'; waypoints.columns says"),
        (b't; x; y; angle\n', "not 't, x, y, angle'"),
        (b't, x, y, phi\n0, 0.5, nan, 0\n', "line 2: 'nan' is not a finite number"),
        (b't, x, y, phi\n0, 0.5, 1e999, 0\n', "line 2: '1e999' is not a finite number"),
        (b't, x, y, phi\n0, 0.5, 1_0, 0\n', "line 2: '1_0' is not a finite number"),
        (b't, x, y\n0, 0.5, left\n', "line 2: 'left' is not a finite number"),
        (b't, x, y\n0, 0.5\n', 'line 2 must hold 3 numbers, not 2'),
        (b't, x, y\n0, 0.5, 0.3\n2, 0.5, 0.3\n1, 0.5, 0.3\n', 'line 4: t = 1 is not after 2'),
        (b't, x, y\n0, 0.5, 0.3\n0.0, 0.6, 0.3\n', 'line 3: t = 0 is not after 0'),
        (b't, x, y\n0, 0.5, 0.3\n', 'must hold at least 2 points, not 1'),
        (b'\x7fELF\x80\xff', 'is not a text in UTF-8'),
        (b't, x, y\n' + b'a' * 200_000, 'field larger than field limit'),
        (b'a' * 200_000 + b'\n0, 1, 2\n', 'waypoints.columns says which column is what'),
        (b'# from a camera\nt; x; y; angle\n', 'line 2: the header must be'),
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


JOINTS = {
    'paper_circle': np.array(
        [[0.9, 2.1, 4.6], [1.0, 2.2, 4.7], [0.95, 2.3, 4.65], [0.9, 2.1, 4.6]]
    ),
    'serial_2r_circle': np.array([[0.4, 1.2], [0.7, 1.0], [0.5, 1.5], [0.4, 1.2]]),
    'axes_step': np.array([[0.0] * 5, [0.02] * 5, [0.01] * 5, [0.0] * 5]),
}


@pytest.mark.parametrize('of', JOINTS)
def test_points_in_joints_are_followed_in_joints(of, scenario):
    """By every robot: the reference of its joints is the spline through the points by scipy."""
    values = config.resolve(of)
    start = trajectory_of(values).sample(0.0).position[0]
    points, times = JOINTS[of] - JOINTS[of][0] + start, np.array([0.0, 0.8, 1.5, 2.6])
    rows = [','.join(map(repr, [*row])) for row in np.column_stack([times, points]).tolist()]
    header = ','.join(['t', *(f'q{k + 1}' for k in range(points.shape[1]))])
    path = scenario.parent / 'points.csv'
    path.write_text('\n'.join([header, *rows]))
    changes = {'trajectory.shape': 'waypoints', 'waypoints.file': str(path)}
    grid = np.linspace(0.0, 2.6, 1001)
    followed = trajectory_of(config.resolve(of, changes)).sample(grid)
    rest = [(1, np.zeros(points.shape[1])), (2, np.zeros(points.shape[1]))]
    theirs = make_interp_spline(times, points, k=5, bc_type=(rest, rest))
    assert np.abs(followed.position - theirs(grid)).max() < 1e-10
    assert np.abs(followed.velocity - theirs(grid, nu=1)).max() < 1e-8
    assert np.abs(followed.acceleration - theirs(grid, nu=2)).max() < 1e-5


def test_a_long_motion_in_joints_takes_no_more_memory(scenario, monkeypatch):
    monkeypatch.setattr(joint_path, 'MOST', 200)
    path = scenario.parent / 'points.csv'
    path.write_text('t,q1,q2\n0,1,1\n1e9,1.1,1.2\n2e9,1.2,1.3\n')
    changes = {'trajectory.shape': 'waypoints', 'waypoints.file': str(path)}
    made = trajectory_of(config.resolve('serial_2r_circle', changes))
    assert len(made.shape.knots) == 201
    assert made.sample(1e9).position[0] == pytest.approx([1.1, 1.2], abs=1e-9)


@pytest.mark.parametrize(
    ('joints', 'reason'),
    [
        ([[0.9, 2.1], [1.0, 2.2]], 'waypoints.points have 2 joints; planar_3rrr has 3'),
        ([[0.9, 2.1, 4.6], [3.0, 0.0, 1.0]], 'waypoints.points: at t = '),
    ],
)
def test_joints_that_the_robot_cannot_have_cost_one_line(scenario, joints, reason, capsys):
    header = ['t,q1,q2', 't,q1,q2,q3'][len(joints[0]) - 2]
    rows = [','.join(map(str, [k, *row])) for k, row in enumerate(joints)]
    (scenario.parent / 'points.csv').write_text('\n'.join([header, *rows]))
    assert main(['simulate', str(scenario), '--out', 'bag']) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and reason in error
    assert not (scenario.parent.parent / 'bag').exists()


NUMBERED = ['t=1', 'x=2', 'y=3', 'phi=4']
TABLES = {
    'semicolons': ('t; x; y; phi\n0; 0.5; 0.37; 1.5\n1; 0.51; 0.38; 1.5\n', {}),
    'decimal commas': ('t;x;y;phi\n0;0,5;0,37;1,5\n1;0,51;0,38;1,5\n', {}),
    'tabs and comments': ('# a log\nt\tx\ty\tphi\n0\t.5\t.37\t1.5\n1\t.51\t.38\t1.5\n', {}),
    'spaces': ('# by savetxt\n0.0  0.5 0.37 1.5\n1.0 0.51 0.38 1.5\n', {'columns': NUMBERED}),
    'a separator at the end': ('t,x,y,phi,\n0,0.5,0.37,1.5,\n1,0.51,0.38,1.5,\n', {}),
    'a line twice': ('t,x,y,phi\n0,0.5,0.37,1.5\n0,0.5,0.37,1.5\n1,0.51,0.38,1.5\n', {}),
    'names': (
        'Time,EE X,EE Y,state,Yaw\n0,0.5,0.37,idle,1.5\n1,0.51,0.38,run,1.5\n',
        {'columns': ['y=EE Y', 't=Time', 'x=EE X', 'phi=Yaw']},
    ),
    'no header': (
        '1.5,0.5,0.37,0\n1.5,0.51,0.38,1\n',
        {'columns': ['t=4', 'x=2', 'y=3', 'phi=1']},
    ),
    'units': (
        't,x,y,phi\n0,50,37,85.94366926962348\n1e9,51,38,85.94366926962348\n',
        {'units': ['ns', 'cm', 'deg']},
    ),
}


@pytest.mark.parametrize('name', TABLES)
def test_anybodys_table_is_read_as_the_same_points(name, tmp_path):
    content, options = TABLES[name]
    (tmp_path / 'table.csv').write_text(content)
    options = {f'waypoints.{key}': value for key, value in options.items()}
    options |= {'waypoints.file': str(tmp_path / 'table.csv')}
    values = config.resolve('paper_circle', options)
    assert np.allclose(values['waypoints.times'], [0.0, 1.0], rtol=0.0, atol=1e-15)
    expected = [0.5, 0.37, 1.5, 0.51, 0.38, 1.5]
    assert np.allclose(values['waypoints.points'], expected, rtol=0.0, atol=1e-15)
    assert values['waypoints.columns'] == values['waypoints.units'] == []


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        ({'columns': ['t=t', 'w=x']}, 'waypoints.columns must name t and coordinates'),
        ({'columns': ['t=t', 'x=X', 'y=b']}, "has no column 'X', only 't, x, y, phi'"),
        ({'columns': ['t=9', 'x=x', 'y=y']}, "has no column '9'"),
        ({'columns': 'x'}, "waypoints.columns must be a list of texts, not 'x'"),
        ({'units': ['ms', 'ns']}, 'waypoints.units must name one unit of time'),
        ({'units': ['furlong']}, "waypoints.units: unknown unit 'furlong' (known: s, ms"),
        ({'file': '', 'units': ['mm']}, 'waypoints.units needs waypoints.file beside it'),
    ],
)
def test_options_that_do_not_fit_a_table_cost_one_line(scenario, options, reason):
    changes = {'waypoints.file': str(scenario.parent / 'points.csv')}
    changes |= {f'waypoints.{key}': value for key, value in options.items()}
    with pytest.raises(InputError) as caught:
        config.resolve('paper_circle', changes)
    assert reason in str(caught.value)


def test_a_table_that_is_too_large_is_not_read(scenario, monkeypatch):
    path = scenario.parent / 'points.csv'
    monkeypatch.setattr(points_table, 'MAX_BYTES', len(GOOD) - 1)
    with pytest.raises(InputError, match=f'has more than {len(GOOD) - 1} bytes'):
        points_table.read_table(path)


def test_a_log_of_many_rows_is_thinned_and_told(scenario):
    t = np.arange(12001) * 1e-3
    x = 0.5 + 0.02 * np.sin(np.pi * t / 3.0)
    table = np.column_stack([t, x, np.full_like(t, 0.37), np.full_like(t, 1.57)])
    path = scenario.parent / 'points.csv'
    np.savetxt(path, table, delimiter=',', header='t,x,y,phi', comments='')
    changes = {'trajectory.shape': 'waypoints', 'waypoints.file': str(path)}
    trajectory = trajectory_of(config.resolve('paper_circle', changes))
    (told,) = motion_warnings(trajectory)
    assert 'points.csv has 12001 rows, of which one in 3 is followed' in told
    inner = slice(100, -100)  # it rests at both ends
    assert np.abs(trajectory.poses(t).pose[inner, 0] - x[inner]).max() < 1e-9


def test_numbers_of_other_units_are_doubted(scenario):
    def doubts(of, times=(0.0, 1.0), angle=1.57, **changes):
        points = [0.5, 0.37, angle, 0.51, 0.37, angle]
        changes = {'waypoints.times': [*times], 'waypoints.points': points, **changes}
        values = {'trajectory.shape': 'waypoints', **changes}
        return motion_warnings(trajectory_of(config.resolve(of, values)))

    assert doubts('paper_circle') == ()
    (degrees,) = doubts('paper_circle', angle=90.0)
    assert 'phi reaches 90 rad, 14.3 turns' in degrees and 'must be 1.571 rad' in degrees
    metres = [520.0, 370.0, 1.57, 500.0, 370.0, 1.57]
    told = doubts('paper_circle', **{'waypoints.points': metres})
    assert told[0] == 'waypoints: x reaches 520 m: if that is in mm, it must be 0.52 m'
    assert told[1].startswith('waypoints: y reaches 370 m')
    (nanoseconds,) = doubts('paper_circle', (0.0, 6e9))
    assert 'last 6e+09 s: if they are in ns' in nanoseconds and 'to last 6 s' in nanoseconds
    (dropped,) = doubts('serial_2r_circle')
    assert 'phi, which is not used: the pose of serial_2r is x, y' in dropped
    circle = {'trajectory.shape': 'circle', 'circle.phi': -90.0}
    (degrees,) = motion_warnings(trajectory_of(config.resolve('paper_circle', circle)))
    assert 'circle: phi reaches -90 rad' in degrees
