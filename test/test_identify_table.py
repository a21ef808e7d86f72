"""Recordings that are no bags: tables of joints, CSV and Parquet, are identified like bags."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import parallel_robot as pr
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.configuration import config

SCENARIO = 'serial_2r_circle'
OF_IT = ['--scenario', SCENARIO]
TRUE = [0.43425, 0.183, 0.2205, 1.635]  # a, b, h, w of the arm
HEADER = 't [s], q1 [rad], q2 [rad], tau1 [N m], tau2 [N m]'
GUIDE = Path(__file__).parents[1] / 'docs' / 'identification.md'


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A run of another robot than the scenario's, and its table."""
    found = tmp_path_factory.mktemp('tables')
    words = ['--law', 'pid', '--duration', '9', '--set', 'trajectory.shape=excitation']
    words += ['--set', 'true_robot.m1=3.5', '--set', 'true_robot.mp=1.2']
    assert main(['simulate', SCENARIO, *words, '--out', str(found / 'bag')]) == 0
    return found


@pytest.fixture(scope='module')
def columns(folder):
    """Time, positions and torques of every fourth state: with fewer, the tests are quick."""
    log = recording.read(folder / 'bag').log
    impulse = np.cumsum(log.effort, axis=0)[::4]  # torque acts in the step before its state
    effort = np.vstack([log.effort[:1], np.diff(impulse, axis=0) / 4.0])
    return log.time[::4], log.position[::4], effort


@pytest.fixture
def told(tmp_path, monkeypatch, capsys):
    """Identifies a table of a header and columns; returns exit code, errors and results."""
    monkeypatch.chdir(tmp_path)

    def identify(header, numbers=(), *words):
        rows = (
            ''
            if not len(numbers)
            else '\n'.join(','.join(map(repr, row)) for row in np.column_stack(numbers).tolist())
        )
        Path('x.csv').write_text(f'{header}\n{rows}\n')
        capsys.readouterr()
        code = main(['identify', 'x.csv', *OF_IT, '--format', 'json', *words])
        found = capsys.readouterr()
        return code, found.err, json.loads(found.out) if found.out else None

    return identify


def estimates(found):
    return [each['estimate'] for each in found['base_parameters']]


def written(bag, out, *words):
    assert main(['identify', str(bag), '--out', str(out), *words]) == 0
    return config.flat(yaml.safe_load(out.read_text()))


@pytest.mark.parametrize('suffix', ['csv', 'parquet'])
def test_what_export_writes_is_the_bag(folder, tmp_path, suffix):
    table = tmp_path / f'table.{suffix}'
    assert main(['export', str(folder / 'bag'), '--out', str(table)]) == 0
    own = written(folder / 'bag', tmp_path / 'bag.yaml')
    assert written(table, tmp_path / 'table.yaml', *OF_IT) == own
    assert own['robot.mp'] > 1.05  # that of the scenario: 1


DEGREES = 180.0 / np.pi


@pytest.mark.parametrize(
    ('header', 'sizes', 'words'),
    [
        ('t [ms], q1 [deg], q2 [mrad], tau1 [mN m], tau2 [Nm]', (1e3, DEGREES, 1e3, 1e3, 1), []),
        ('time [ns],q_0 [rad],q_1 [rad],tau_0 [N m],tau_1 [N*m]', (1e9, 1, 1, 1, 1), []),
        ('t [s],q shoulder [rad],q_elbow [rad],torque_shoulder [N m],tau elbow [N m]', 1, []),
        ('t [s],q_A [rad],q_B [rad],tau_A [N m],tau_B [N m]', 1, ['--joints', 'A,B']),
        ('ignored,q1,q2,tau1,tau2', 1, ['--set', 'period=0.004']),
    ],
)
def test_units_names_and_rows_of_one_period(told, columns, header, sizes, words):
    time, position, effort = columns
    numbers = np.column_stack([time + 1.7e9, position, effort]) * sizes
    code, error, found = told(header, [numbers], *words)
    assert code == 0, error
    assert estimates(found)[:4] == pytest.approx(TRUE, rel=1e-3)
    assert ('not used: the columns ignored' in error) == ('ignored' in header)
    assert ('no unit of q1, q2, tau1, tau2' in error) == ('ignored' in header)


def test_the_example_of_the_guide(told, columns, tmp_path, capsys):
    """With currents, and another robot than the reader's."""
    section = GUIDE.read_text().partition('## Data that are no bag')[2]
    header = re.search(r'```text\n(.+)\n', section)[1]
    command = re.search(r'```bash\n.*parallel_robot (.+)\n', section)[1]
    time, position, effort = columns
    told(header, [time, np.degrees(position), effort / [2.0, 0.5]])
    (tmp_path / 'x.csv').rename(tmp_path / 'my_robot.csv')
    (tmp_path / 'runs').mkdir()
    assert main(command.split()) == 0
    found = config.flat(yaml.safe_load((tmp_path / 'runs' / 'my_robot.yaml').read_text()))
    assert found['robot.mp'] > 1.05  # that of the scenario: 1


def test_velocities_are_told_where_there_are_some(told, columns):
    time, position, effort = columns
    velocity = np.gradient(position, time, axis=0)
    line = 'not used: velocities, but for the noise at rest'
    assert line not in told(HEADER, [time, position, effort])[1]
    header = f'{HEADER}, dq1 [rad/s], dq2 [rad/s]'
    assert line in told(header, [time, position, effort, velocity])[1]


def test_a_joint_whose_torques_are_others_is_named(told, columns):
    time, position, effort = columns
    effort = effort.copy()
    effort[:, 1] = effort[::-1, 1]
    code, error, _ = told(HEADER, [time, position, effort])
    assert code == 2 and error.count('\n') == 1
    assert re.search(r'left \(\d+ % of elbow, less than 50 % of the others\), ', error)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda q, tau: (np.degrees(q), tau), r'; a joint reaches .* turns: .*; degrees\?$'),
        (lambda q, tau: (q, 1e-310 * tau), 'effort of shoulder, elbow is zero in every'),
        (lambda q, tau: (q, np.full_like(tau, 0.5)), 'effort of shoulder, elbow is one number in'),
        (
            lambda q, tau: (q, 1e5 * np.where(tau > 0.0, 1, -1)),
            'none of it can be used: .*saturated .*N m\\?',
        ),
        (
            lambda q, tau: (np.repeat(q[::10], 10, axis=0)[: len(q)], tau),
            r'; positions change in \d+ of \d+ states: were they measured less often',
        ),
    ],
    ids=['degrees', 'denormal', 'stuck', 'mA', 'stairs'],
)
def test_what_logs_of_others_hold_is_named(told, columns, change, message):
    time, position, effort = columns
    code, error, _ = told(HEADER, [time, *change(position, effort)])
    assert code == 2 and error.count('\n') == 1 and re.search(message, error), error


def test_degrees_are_doubted_once_where_no_pose_is_found(tmp_path, capsys):
    rows = np.column_stack(
        [
            np.arange(400) / 100.0,
            np.full((400, 3), 131.0) + np.arange(400)[:, None],
            np.sin(np.arange(1200)).reshape(400, 3),
        ]
    )
    header = 't [s],q1 [rad],q2 [rad],q3 [rad],tau1 [N m],tau2 [N m],tau3 [N m]'
    np.savetxt(tmp_path / 'x.csv', rows, delimiter=',', header=header, comments='')
    assert main(['identify', str(tmp_path / 'x.csv'), '--scenario', 'excitation']) == 2
    assert capsys.readouterr().err.count('degrees?') == 1


def test_angles_that_leap_by_a_turn_are_those_that_go_on(told, columns):
    time, position, effort = columns
    middle = position.mean(axis=0)
    _, _, own = told(HEADER, columns)
    wrapped = (position - middle) % (2.0 * np.pi) + middle
    code, error, found = told(HEADER, [time, wrapped, effort])
    assert code == 0 and 'joints leap by a whole turn: leaps are taken out' in error
    assert estimates(found) == pytest.approx(estimates(own), rel=1e-6)


def test_currents_are_told_by_the_joint_that_friction_does_not_rule(told, columns):
    time, position, effort = columns
    rubbing = 300.0 * np.sign(np.gradient(position[:, 1]))
    effort = 0.1 * np.column_stack([effort[:, 0], effort[:, 1] + rubbing])
    _, error, _ = told(HEADER, [time, position, effort], '--set', 'plant.torque_limit=1000')
    assert 'of those of the robot of the configuration: are the efforts in N m, and no' in error


def test_stamps_of_their_own_and_empty_cells(told, columns):
    """Of rows at irregular times, some without a number."""
    time, position, effort = (each.copy() for each in columns)
    rng = np.random.default_rng(3)
    kept = np.sort(rng.choice(len(time), len(time) // 2, replace=False))
    impulse = np.cumsum(effort, axis=0)[kept]
    effort = np.vstack([effort[:1], np.diff(impulse, axis=0) / np.diff(kept)[:, np.newaxis]])
    time, position = time[kept], position[kept]
    position[[100, 200, 201], 0] = np.nan
    code, error, found = told(HEADER, [time, position, effort])
    assert code == 0 and f'3 of {len(kept)} lines lack a number' in error
    assert estimates(found)[:4] == pytest.approx(TRUE, rel=1e-3)


def test_parts_of_a_table_and_another_one(told, columns, tmp_path):
    figure = tmp_path / 'torques.png'
    words = ['--from', '0.5', '--to', '6', '--hold-out', '0', '--figure', str(figure)]
    code, _, found = told(HEADER, columns, *words, '--validate', '6:9')
    assert code == 0 and figure.exists() and found['duration_s'] < 6.0
    (tmp_path / 'y.csv').write_text((tmp_path / 'x.csv').read_text())
    code, _, found = told(HEADER, columns, '--validate', 'y.csv')
    assert code == 0 and found['torque_error_rms_nm']


def test_torque_constants_of_python(told, columns):
    time, position, effort = columns
    told('t [s],q1 [rad],q2 [rad],i1 [A],i2 [mA]', [time, position, effort * [-0.5, -500.0]])
    found = pr.identify('x.csv', scenario=SCENARIO, torque_constant=-2.0)
    assert found.found.fit.values[:4] == pytest.approx(TRUE, rel=1e-3)
    assert found.constants is None
    found = pr.identify('x.csv', scenario=SCENARIO, torque_constant=(-2.0, 'auto'))
    assert found.constants.values == pytest.approx([-2.0, -2.0], rel=1e-3)
    for wrong, line in (('x', 'torque_constant must be numbers'), ([2, 0], 'finite number but 0')):
        with pytest.raises(pr.InputError, match=line):
            pr.identify('x.csv', scenario=SCENARIO, torque_constant=wrong)


OF_CURRENTS = 't [s],q1 [rad],q2 [rad],i1 [A],i2 [A]'


@pytest.mark.parametrize(
    ('given', 'robot', 'true'),
    [
        ('-0.5,auto', [], [-0.5, 4.0]),
        ('auto,4', [], [-0.5, 4.0]),
        ('auto', ['--set', 'robot.m1=3.5', '--set', 'robot.mp=1.2'], [-0.5, 4.0]),
    ],
)
def test_torque_constants_are_found(given, robot, true, told, columns):
    """With noise of a percent; that of another joint is known, or the bodies."""
    time, position, effort = columns
    rng = np.random.default_rng(5)
    current = (effort + 0.01 * effort.std(axis=0) * rng.normal(size=effort.shape)) / true
    words = [f'--torque-constant={given}', *robot]
    code, _, found = told(OF_CURRENTS, [time, position, current], *words)
    assert code == 0 and estimates(found)[:4] == pytest.approx(TRUE, rel=0.02)
    for each, constant in zip(found['torque_constants'], true, strict=True):
        assert each['value'] == pytest.approx(constant, rel=0.01)
        assert abs(each['value'] - constant) <= max(each['half_width'], 0.005 * abs(constant))
    assert sum(each['half_width'] == 0.0 for each in found['torque_constants']) == 1


def test_a_joint_that_stands_still_does_not_tell_its_torque_constant(told, columns):
    time, position, effort = columns
    position = position * [1.0, 0.0]
    words = ['--torque-constant', '1,auto']
    code, error, _ = told(OF_CURRENTS, [time, position, effort], *words)
    assert code == 2 and 'not tell the torque constant of elbow: give it by' in error


def test_parquet_with_dates(columns, tmp_path):
    time, position, effort = columns
    stamps = (1.7e18 + 1e9 * time).astype('datetime64[ns]')
    table = {'t': stamps, 'q1': position[:, 0], 'q2': position[:, 1]}
    table |= {'tau1': effort[:, 0], 'tau2': effort[:, 1]}
    pyarrow = pytest.importorskip('pyarrow')
    pytest.importorskip('pyarrow.parquet').write_table(
        pyarrow.table(table), tmp_path / 'x.parquet'
    )
    found = pr.identify(tmp_path / 'x.parquet', scenario=SCENARIO)
    assert found.found.fit.values[:4] == pytest.approx(TRUE, rel=1e-3)


@pytest.mark.parametrize(
    ('header', 'take', 'words', 'line'),
    [
        ('t,q1,q2', 'tq', (), r'torques are needed: columns as tau1 \[N m\], or currents'),
        ('t,q1,q2,i1,i2', 'tqe', (), r'or currents as i1 \[A\] and --torque-constant \[N m/A\]'),
        ('t,q1,q2,i1,i2', 'tqe', ('--torque-constant', '1,2,3'), 'one for each of 2 joints'),
        ('t,q1,q2,i1,i2', 'tqe', ('--torque-constant', 'auto,0'), 'of 2 joints, not auto, 0'),
        ('t,q1,q2,i1,i2', 'tqe', ('--torque-constant', 'nan,auto'), 'of 2 joints, not nan, auto'),
        ('t,q1,q2,tau1,tau2', 'tqe', ('--torque-constant', '2'), r'needs currents, columns as i1'),
        ('t,q1,q2,q3,tau1,tau2', 'tqte', (), 'the column q3: the robot has 2 joints, shoulder'),
        ('t,q1,tau1,tau2,x', 'tqe', (), 'there is no column q of elbow'),
        ('t,q1,q1,tau1,tau2', 'tqe', (), 'q1 and q1 are both q of shoulder'),
        ('t,q1 [mm],q2,tau1,tau2', 'tqe', (), 'q of a hinge must be one of rad, mrad, deg, turn'),
        ('t [h],q1,q2,tau1,tau2', 'tqe', (), 'a time must be one of s, ms, us, ns, min'),
        ('q1,q2,tau1,tau2', 'qe', (), r'times as t \[s\], or --set period=S'),
        ('0,1,2,3,4', 'tqe', (), r'the header must be such as t \[s\], q1 \[deg\]'),
        ('t,q1,q2,tau1,tau2', 'tDe', (), 'no unit of q1, q2, t, tau1, tau2: taken to be s, rad'),
        (f'{HEADER}\n0,1,2,3,4\n1,2,3,4,5\n1,2,3,4,6', '', (), 'line 4: t = 1 is not after 1;'),
        (f'{HEADER}\n0,1,x,3,4', '', (), "line 2: 'x' is not a number"),
        (f'{HEADER}\n0,1,2,3', '', (), 'line 2 must hold 5 numbers, not 4'),
        (f'{HEADER}\n0,1,,3,4\n1,nan,3,4,5', '', (), 'fewer than two lines have numbers'),
    ],
)  # fmt: skip
def test_what_does_not_go_together_costs_one_line(told, columns, header, take, words, line):
    time, position, effort = columns
    of = {'t': time, 'q': position, 'e': effort, 'D': np.degrees(position)}
    code, error, _ = told(header, [of[each] for each in take], *words)
    assert code == 2 and error.count('\n') == 1 and re.search(line, error), error


def test_parquet_without_its_library(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__('sys').modules, 'pyarrow', None)
    (tmp_path / 'x.parquet').touch()
    assert main(['identify', str(tmp_path / 'x.parquet'), *OF_IT]) == 2
    assert 'pip install pyarrow, or give a .csv' in capsys.readouterr().err


def test_a_bag_has_no_currents(folder, capsys):
    assert main(['identify', str(folder / 'bag'), '--torque-constant', '2']) == 2
    assert 'for currents in a table, not for the bag' in capsys.readouterr().err


def test_poses_calibrate_the_robot_of_a_table(folder, tmp_path, capsys):
    """What the exported table of a longer arm says of its tip, beside its joints."""
    frame = pr.export(folder / 'bag')
    poses = frame.iloc[::200][['time_s', 'platform_x_m', 'platform_y_m']]
    poses.columns = ['t', 'x', 'y']
    poses.assign(x=1.01 * poses.x, y=1.01 * poses.y).to_csv(tmp_path / 'poses.csv', index=False)
    frame.to_csv(tmp_path / 'joints.csv', index=False)
    words = ['calibrate', str(tmp_path / 'joints.csv'), '--poses', str(tmp_path / 'poses.csv')]
    capsys.readouterr()
    assert main([*words, *OF_IT, '--out', str(tmp_path / 'robot.yaml')]) == 0
    found = config.flat(yaml.safe_load((tmp_path / 'robot.yaml').read_text()))
    assert [found['robot.l1'], found['robot.l2']] == pytest.approx([0.303, 0.303], abs=1e-4)
