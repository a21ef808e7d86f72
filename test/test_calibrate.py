"""The command ``calibrate``, and its function for Python."""

import json
import re
import shlex
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from bags import STORE, content, write_foreign

import parallel_robot as pr
from parallel_robot.bags import indexed_reader
from parallel_robot.bags.run import recorded_robot
from parallel_robot.cli.command_line import main
from parallel_robot.studies.calibration import bag_calibration, measured_poses
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages.topics import JOINT_STATES, Topic
from parallel_robot_model.processes.termination_signals import Terminated

TRUE = {  # all of it: what is not said follows the robot that is believed in
    'true_robot.l1': 0.4008,
    'true_robot.l2': 0.5993,
    'true_robot.l3': 0.2,
    'true_robot.base_x': [0.001, 0.9995, 0.5],
    'true_robot.base_y': [0.0, 0.0, 0.8660254],
    'true_robot.platform_angle': [3.6651914, 5.7595865, 1.5707963],
    'sensor.zero_angle': [0.002, -0.001, 0.001],
}
NOISE = np.array([1e-5, 1e-5, 5e-5])
POSES = 12


def run(*words):
    return main([str(word) for word in words])


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    """A robot that is not quite ours in the poses that tell most, and what a tracker saw."""
    folder = tmp_path_factory.mktemp('calibrate')
    motion, bag, poses = (folder / name for name in ('motion.yaml', 'bag', 'poses.csv'))
    words = ('calibrate', '--scenario', 'paper_circle', '--design', POSES, '--out', motion)
    assert run(*words) == 0
    joined = {'approach.duration': 0.4, 'sensor.position_noise': 5e-6}
    made = pr.simulate(
        'paper_circle', law='observer_s_fotsmc', param_file=motion, **joined, **TRUE
    )
    assert made.fault is None  # the chosen motion can be run
    pr.save(made, bag)
    rng = np.random.default_rng(1)
    rows = np.arange(1000, len(made.time), 250)
    pose = made.pose[rows] + NOISE * rng.normal(size=(len(rows), 3))
    table = np.column_stack([made.time[rows], pose])
    np.savetxt(poses, table, '%.9f', ',', header='t,x,y,phi', comments='')
    [file] = bag.glob('*.mcap')
    states = content(file)['joint_states']
    return SimpleNamespace(bag=bag, poses=poses, table=table, states=states)


@pytest.fixture(scope='module')
def whole(case):
    """The calibration by all poses of the file."""
    return pr.calibrate(case.bag, poses=case.poses)


def tracker(file, header, table):
    np.savetxt(file, table, '%.9f', ',', header=header, comments='')
    return file


def test_a_header_may_tell_the_units_that_count(case, whole, tmp_path):
    told = tracker(tmp_path / 'told.csv', 't [s],x [m],y [m],phi [rad]', case.table)
    found = pr.calibrate(case.bag, poses=told).found.values
    assert found.tolist() == whole.found.values.tolist()
    other = tracker(tmp_path / 'other.csv', 't [s],x [mm],y [mm],phi [rad]', case.table)
    with pytest.raises(InputError, match=r'then some of x, y, phi in m and rad, not .*x \[mm\]'):
        pr.calibrate(case.bag, poses=other)


def test_joints_that_stand_are_told_from_lengths_in_mm(case, tmp_path):
    joints, poses = tmp_path / 'joints.csv', tmp_path / 'poses.csv'
    stand = np.column_stack([case.table[:, 0], np.full((len(case.table), 2), 0.5)])
    header = 't [s],q1 [rad],q2 [rad]'
    np.savetxt(joints, stand, delimiter=',', header=header, comments='')
    tracker(poses, 't,x,y', case.table[:, :3])
    with pytest.raises(BagError, match='the joints stand at one place at all poses'):
        pr.calibrate(joints, scenario='serial_2r_circle', poses=poses)


def test_the_true_robot_is_found_and_its_file_makes_a_loop_right(case, tmp_path, capsys):
    out, figure = tmp_path / 'robot.yaml', tmp_path / 'calibrated.png'
    words = ('calibrate', case.bag, '--poses', case.poses, '--out', out, '--figure', figure)
    words = (*words, '--format', 'json')
    capsys.readouterr()
    assert run(*words) == 0
    found = json.loads(capsys.readouterr().out)
    unknown = {each['name']: each for each in found['unknown']}
    for name, truth in {
        'robot.l1': 0.4008,
        'robot.l3': 0.2,
        'robot.base_x[0]': 0.001,
        'zero angle of joint2': -0.001,
    }.items():
        assert abs(unknown[name]['estimate'] - truth) < 2.5 * unknown[name]['half_width_95'], name
    assert not found['kept'] and not found['not_told']  # it moves, so clocks can be compared
    assert abs(unknown['clock']['estimate']) < 1e-4
    assert found['pose_error_rms']['x']['noise'] == pytest.approx(1e-5, rel=0.15)
    assert figure.read_bytes().startswith(b'\x89PNG')
    # The file is a configuration of which a loop is right.
    content = yaml.safe_load(out.read_text())
    values = config.flat(content)
    assert '&' not in out.read_text() and 'robot.m1' not in values
    law = {'law': 'observer_s_fotsmc', 'duration': 4}
    before = pr.simulate('paper_circle', **law, **TRUE)
    after = pr.simulate('paper_circle', param_file=out, **law, **TRUE)
    errors = [pr.metrics(each)['xy_rms_m'] for each in (before, after)]
    assert errors[0] > 1e-3 and errors[1] < 15e-6


def test_the_table_says_what_was_found_and_python_finds_the_same(case, whole, capsys):
    capsys.readouterr()
    assert run('calibrate', case.bag, '--poses', case.poses) == 0
    out = capsys.readouterr().out
    assert out == '\n'.join(whole.lines()) + '\n' == f'{whole!r}\n'
    assert 'robot.base_y[2]' in out and 'condition number' in out and 'phi [µrad]' in out
    lines = [line.split() for line in out.splitlines()]
    for name, errors in whole.as_data()['pose_error_rms'].items():
        [shown] = [words[2:] for words in lines if words[:2] in ([name, '[µm]'], [name, '[µrad]'])]
        found = [1e6 * errors[when] for when in ('before', 'now', 'noise')]
        assert [*map(float, shown)] == pytest.approx(found, rel=1e-3)
    for unknown in whole.as_data()['unknown']:
        place = len(unknown['name'].split())
        [shown] = [words[place:] for words in lines if words[:place] == unknown['name'].split()]
        assert float(shown[0]) == pytest.approx(unknown['estimate'], rel=1e-6, abs=1e-9)
        assert float(shown[3]) == pytest.approx(1e6 * unknown['half_width_95'], rel=1e-2)
    assert whole.values['robot.l1'] == pytest.approx(whole.robot.parameters.l1, rel=1e-9)
    assert whole.values['estimator.zero_angle'] == whole.values['sensor.zero_angle']


@pytest.mark.parametrize('suffix', ['png', 'pdf', 'svg'])
def test_the_picture_has_the_errors_before_and_after_and_the_changes(whole, tmp_path, suffix):
    drawn = whole.draw()
    errors = [axes for axes in drawn.axes if axes.get_ylabel().startswith('|error| of ')]
    assert [axes.get_ylabel() for axes in errors] == [
        f'|error| of {name}' for name in ('x [µm]', 'y [µm]', 'phi [µrad]')
    ]
    rms = whole.as_data()['pose_error_rms']
    for axes, name in zip(errors, rms, strict=True):
        lines = {line.get_label(): 1e-6 * line.get_ydata() for line in axes.lines[:2]}
        for when in ('before', 'now'):
            assert np.sqrt(np.mean(lines[when] ** 2)) == pytest.approx(rms[name][when])
    changes = {
        label.get_text(): x
        for axes in drawn.axes[len(errors) :]
        for label, x in zip(axes.get_yticklabels(), axes.lines[0].get_xdata(), strict=True)
    }
    assert [*changes] == [each.name for each in whole.model.unknown]
    change = whole.values['robot.l1'] - 0.4
    assert 1e-6 * changes['robot.l1'] == pytest.approx(change, rel=1e-6)
    whole.save_figure(tmp_path / f'picture.{suffix}')
    assert (tmp_path / f'picture.{suffix}').stat().st_size > 5000
    with pytest.raises(InputError, match='cannot write'):
        whole.save_figure(tmp_path / f'picture.{suffix}')


def test_stamps_other_columns_and_gaps_in_the_tracker_do_not_matter(case, whole, tmp_path):
    file, start = tmp_path / 'poses.csv', start_of(case)
    lines = ['z, phi , y,x, stamp']
    for k, (t, x, y, phi) in enumerate(case.table):
        cells = ['nan', ''] if k % 50 == 7 else [repr(float(phi)), repr(float(y))]
        lines.append(','.join(['0.1', *cells, repr(float(x)), str(start + round(1e9 * t))]))
    file.write_text('\n'.join(lines) + '\n\n')
    found = pr.calibrate(case.bag, poses=file)
    assert any('not used: the columns z' in line for line in found.warnings)
    assert any('lines without a pose' in line for line in found.warnings)
    assert found.values['robot.l2'] == pytest.approx(whole.values['robot.l2'], abs=2e-5)


def test_the_bag_of_another_recorder_takes_its_topic_its_joints_and_a_part(case, whole, tmp_path):
    """It has no configuration: the robot is that of a scenario, its clock starts with it."""
    write_foreign(tmp_path / 'bag', {Topic('arm/states', JOINT_STATES.type): case.states})
    part = {'start': 1.0, 'stop': 6.0}
    own = pr.calibrate(case.bag, poses=case.poses, **part)
    topic = {'joint_states': '/arm/states'}
    other = pr.calibrate(tmp_path / 'bag', poses=case.poses, topic=topic, **part)
    assert own.values['robot.l1'] == pytest.approx(other.values['robot.l1'], abs=1e-7)
    assert len(own.found.left) < len(whole.found.left)


def test_of_a_long_bag_the_states_near_the_poses_suffice(case, tmp_path, monkeypatch):
    """All poses together have as many states as may be kept; the others are never looked at."""
    file, table = tmp_path / 'poses.csv', case.table[::5]
    tracker(file, 't,x,y,phi', table)
    all_of_them = pr.calibrate(case.bag, poses=file)
    kept = 50 * len(table)
    monkeypatch.setattr(measured_poses, 'KEPT', kept)
    monkeypatch.setattr(bag_calibration, 'KEPT', kept)
    monkeypatch.setattr(recorded_robot, 'SECONDS', 1.3)
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)
    found = pr.calibrate(case.bag, poses=file)
    assert len(found.model.track.time) <= kept + len(table) < len(all_of_them.model.track.time)
    assert found.warnings == all_of_them.warnings
    for one, other in zip(found.values.values(), all_of_them.values.values(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)
    late = tracker(tmp_path / 'late.csv', 't,x,y,phi', np.add(table, [0.04, 0, 0, 0]))
    [doubt, *_] = pr.calibrate(case.bag, poses=late).warnings
    assert 'the clock of the tracker is off by more than 0.0' in doubt


@pytest.mark.parametrize('kind', ['file', 'topic'])
def test_of_many_poses_some_are_kept_evenly(kind, case, tmp_path, monkeypatch):
    """Of a long bag while they are read; of a short one all are, and those in its time count."""
    most, table = 40, case.table
    file = tracker(tmp_path / 'poses.csv', 't,x,y,phi', table[::-1])
    bag = recorded(case, tmp_path / 'bag', 'geometry_msgs/msg/PoseStamped', 'tracker')
    words = {'file': {'bag': case.bag, 'poses': file}, 'topic': {'bag': bag}}[kind]
    monkeypatch.setattr(bag_calibration, 'MOST', most)
    short = pr.calibrate(**words)
    for module in (measured_poses, bag_calibration):
        monkeypatch.setattr(module, 'KEPT', len(case.states) - 1)
    long = pr.calibrate(**words)
    rows = np.linspace(0, len(table) - 1, most).astype(int)
    assert len(table) > most
    for found in (short, long):
        np.testing.assert_allclose(found.model.measured.time, table[rows, 0], atol=1e-8)
        np.testing.assert_allclose(found.model.measured.pose, table[rows, 1:], atol=1e-8)
        what = f'{file if kind == "file" else bag}: of {len(table)} poses, {most} are used'
        assert any(what in line for line in found.warnings)


def start_of(case):
    """Stamp of t = 0 of its bag [ns]."""
    _, data = case.states[0]
    message = STORE.deserialize_cdr(data, JOINT_STATES.type)
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_a_tracker_that_strays_is_doubted(case, tmp_path):
    table = case.table.copy()
    table[11, 1] += 3e-3
    poses = tracker(tmp_path / 'poses.csv', 't,x,y,phi', table)
    found = pr.calibrate(case.bag, poses=poses)
    [warning] = found.warnings
    assert f'1 of {len(table)} poses are more than 6 standard deviations' in warning
    assert f't = {table[11, 0]:.3f} s (x by 3.0' in warning
    assert warning.endswith('--robust leaves them out')
    for robust, what in ((False, 'used, too'), (True, 'left out')):  # the file says it, too
        found, out = pr.calibrate(case.bag, poses=poses, robust=robust), tmp_path / f'{what}.yaml'
        found.write(out)
        said = f'# 1 of {len(table)} poses are more than 6 standard deviations beside'
        [line] = [each for each in out.read_text().splitlines() if said in each]
        assert line.endswith(f': {what}.')


def test_a_robust_calibration_is_that_of_the_poses_without_outliers(
    case, tmp_path, capsys, monkeypatch
):
    """The example of the page: without it, outliers hide behind what they leave."""
    page = (config.directory().parent / 'docs' / 'calibration.md').read_text()
    [section] = re.findall(r'## Outliers\n(.*?)\n## ', page, re.DOTALL)
    [program, command] = re.findall(r'```(?:python|bash)\n(.*?)```', section, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    Path('runs').mkdir()
    Path('runs/stood').symlink_to(case.bag)
    Path('runs/poses.csv').write_text(case.poses.read_text())
    exec(program, {})
    poses, out = Path('lost.csv'), Path('runs/robust.yaml')
    table = np.loadtxt(poses, delimiter=',', skiprows=1)
    capsys.readouterr()
    assert run('calibrate', 'runs/stood', '--poses', poses) == 2
    error = capsys.readouterr().err
    assert 'no geometry explains the poses' in error and '--robust leaves them out' in error
    assert run(*shlex.split(command)[1:], '--format', 'json') == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert ' more between t = ' in told.err and told.err.endswith(' s; left out\n')
    times = {each['time'] for each in found['outliers']}
    moved = np.abs(table - case.table)[:, 1:].max(axis=1) > 20 * NOISE.max()
    assert {*table[moved, 0].round(6)} <= {round(time, 6) for time in times}
    assert len(times) + found['poses'] == len(table)
    assert found['starts'] == {'tried': 1, 'agreeing': 1, 'rivals': 0}
    kept = table[~np.isin(table[:, 0].round(6), [round(time, 6) for time in times])]
    other = pr.calibrate(case.bag, poses=tracker(tmp_path / 'kept.csv', 't,x,y,phi', kept))
    assert not other.warnings
    again = pr.calibrate('runs/stood', poses=poses, robust=True)
    assert again.as_data() == found and again.values == config.flat(
        yaml.safe_load(out.read_text())
    )
    for one, two in zip(found['unknown'], other.as_data()['unknown'], strict=True):
        assert one['estimate'] == pytest.approx(two['estimate'], abs=1e-8), one['name']
        assert one['half_width_95'] == pytest.approx(two['half_width_95'], rel=1e-3)
    worst = max(found['outliers'], key=lambda each: each['x']['deviations'])
    row = int(np.argmin(np.abs(table[:, 0] - worst['time'])))
    assert worst['x']['off'] == pytest.approx((table - case.table)[row, 1], abs=1e-4)
    assert worst['x']['unit'] == 'm'


def test_zero_angles_that_are_known_are_found_again(whole, tmp_path):
    """A second calibration of a loop with the first: nothing changes."""
    still = {'approach.duration': 0.4, 'law': 'pid', 'duration': 6}
    again = pr.simulate('paper_circle', **still, **{**whole.values, **TRUE})
    pr.save(again, tmp_path / 'bag')
    rows = np.arange(1000, 6000, 25)
    pose = again.pose[rows] + NOISE * np.random.default_rng(2).normal(size=(len(rows), 3))
    table = np.column_stack([again.time[rows], pose])
    second = pr.calibrate(tmp_path / 'bag', poses=tracker(tmp_path / 'p.csv', 't,x,y,phi', table))
    start = second.model.start[second.model.zeros]
    assert start == pytest.approx(whole.values['estimator.zero_angle'], abs=1e-9)
    assert np.sqrt((second.found.before[:, :2] ** 2).mean()) < 1.5e-5
    off = np.abs(second.found.values - second.model.start)
    assert (off <= 4.0 * second.found.half_widths + 1e-12).all()


KINDS = {
    'geometry_msgs/msg/PoseStamped': lambda types, header, pose: types.PoseStamped(header, pose),
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda types, header, pose: (
        types.PoseWithCovarianceStamped(header, types.PoseWithCovariance(pose, np.zeros(36)))
    ),
    'geometry_msgs/msg/TransformStamped': lambda types, header, pose: types.TransformStamped(
        header, 'target', types.Transform(
            types.Vector3(pose.position.x, pose.position.y, pose.position.z), pose.orientation
        )
    ),
}  # fmt: skip


def recorded(case, folder, kind, topic, frame='world', lost=()):
    """A bag of joint states alone, and poses as rosbags serialises them."""
    types = SimpleNamespace(
        **{name.rpartition('/')[2]: each for name, each in STORE.types.items() if '/msg/' in name}
    )
    start, messages = start_of(case), []
    for k, (t, x, y, phi) in enumerate(case.table):
        stamp = start + round(1e9 * t)
        header = types.Header(types.Time(*divmod(stamp, 10**9)), frame[: len(frame) - k % 2])
        turned = types.Quaternion(0.0, 0.0, float(np.sin(phi / 2)), float(np.cos(phi / 2)))
        x, y = (float('nan') if k in lost else float(each) for each in (x, y))
        pose = types.Pose(types.Point(x, y, 0.2), turned)
        message = KINDS[kind](types, header, pose)
        messages.append((stamp, bytes(STORE.serialize_cdr(message, kind))))
    streams = {JOINT_STATES: case.states, Topic(topic, kind): messages}
    write_foreign(folder, streams)
    return folder


@pytest.mark.parametrize('kind', [*KINDS])
def test_poses_in_the_bag_are_those_of_the_file(case, tmp_path, kind):
    bag = recorded(case, tmp_path / 'bag', kind, 'tracker/pose_of_target')
    found = measured_poses.read_topic(bag)
    np.testing.assert_allclose(found.place[:, :2], case.table[:, 1:3], atol=1e-9)
    np.testing.assert_allclose(found.phi, case.table[:, 3], atol=1e-9)


def test_messages_without_a_pose_are_told_and_broken_ones_refused(case, tmp_path):
    kind = 'geometry_msgs/msg/PoseStamped'
    bag = recorded(case, tmp_path / 'bag', kind, 'tracker', lost=(5, 9))
    found = pr.calibrate(bag)
    assert any('not used: 2 messages without a pose' in line for line in found.warnings)
    assert len(found.model.measured.time) == len(case.table) - 2
    cut = [(k, bytes([0, 1, 0, 0, *([255] * 40)])) for k in range(10**9, 10**9 + 5)]
    streams = {JOINT_STATES: case.states, Topic('tracker', kind): cut}
    write_foreign(tmp_path / 'broken', streams)
    with pytest.raises(BagError, match='tracker is not understood: a message is broken'):
        pr.calibrate(tmp_path / 'broken')


@pytest.mark.parametrize('kind', [*KINDS])
def test_either_order_of_bytes_is_read(case, tmp_path, kind, monkeypatch):
    other, serialize = tmp_path / 'other', STORE.serialize_cdr
    wanted = measured_poses.read_topic(recorded(case, tmp_path / 'bag', kind, 'tracker'))
    with monkeypatch.context() as patched:
        big = partial(serialize, little_endian=False)
        patched.setattr(STORE, 'serialize_cdr', big)
        recorded(case, other, kind, 'tracker')
    found = measured_poses.read_topic(other)
    assert all(map(np.array_equal, found, wanted))


@pytest.mark.parametrize('length', [1, 3, 11, 40])
def test_a_message_that_is_too_short_is_called_broken(length, case, tmp_path):
    cut = [(10**9, bytes([0, 1, *bytes(length)][:length]))]
    streams = {JOINT_STATES: case.states, Topic('tracker', 'geometry_msgs/msg/PoseStamped'): cut}
    write_foreign(tmp_path / 'bag', streams)
    with pytest.raises(BagError, match='tracker is not understood: a message is broken'):
        measured_poses.read_topic(tmp_path / 'bag')


def test_one_topic_of_poses_is_chosen(case, whole, tmp_path, capsys):
    bag = recorded(case, tmp_path / 'bag', 'geometry_msgs/msg/PoseStamped', 'tracker')
    calibrated = pr.calibrate(bag)
    for key, value in whole.values.items():
        np.testing.assert_allclose(calibrated.values[key], value, atol=2e-6, err_msg=key)
    assert run('calibrate', bag, '--pose-topic', '/tracker') == 0
    capsys.readouterr()
    assert run('calibrate', bag, '--pose-topic', 'traker') == 2
    error = capsys.readouterr().err
    assert '/traker is not there; it has /tracker' in error and error.count('\n') == 1


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['{tmp}/none', '--poses', '{poses}'], 'none'),
        (['{bag}'], 'has no topic of measured poses'),
        (['{bag}', '--pose-topic', 'pose'], 'is computed from the joints, not measured'),
        (['{bag}', '--pose-topic', 'joint_states'], 'JointState, not of poses'),
        (['{bag}', '--poses', '{tmp}/none.csv'], 'cannot read'),
        (['{bag}', '--poses', '{header}'], 'must name t [s] or stamp [ns], then some of x'),
        (['{bag}', '--poses', '{word}'], "line 3: 'one' is not a finite number"),
        (['{bag}', '--poses', '{short}'], 'line 2 must hold 4 values, not 3'),
        (['{bag}', '--poses', '{empty}'], 'holds no pose'),
        (['{bag}', '--poses', '{late}'], 'no pose was measured while the joints were recorded'),
        (['{bag}', '--poses', '{few}'], '3 poses of 3 numbers are too few for 16 unknown'),
        (['{bag}', '--poses', '{poses}', '--out', '{poses}'], 'exists; nothing is overwritten'),
        (['{bag}', '--poses', '{poses}', '--figure', '{tmp}/x.txt'], 'unknown picture format'),
        (['{bag}', '--poses', '{poses}', '--set', 'robot.l1=1'], '--override permits that'),
        (['{bag}', '--poses', '{poses}', '--free', 'fram'], "did you mean 'frame'?"),
        ([], 'takes either a bag or --scenario'),
        (['--scenario', 'paper_circle', '--design', '3'], 'must be at least 5 poses for 15'),
        (['--scenario', 'paper_circel', '--design', '9'], "did you mean 'paper_circle'?"),
    ],
)  # fmt: skip
def test_what_is_wrong_costs_one_line(case, tmp_path, capsys, words, message):
    files = {
        'header': 'time,x,y\n1,2,3\n',
        'word': 't,x,y,phi\n1,0,0,0\n2,one,0,0\n',
        'short': 't,x,y,phi\n1,0,0\n',
        'empty': 't,x,y,phi\n',
        'late': 't,x,y,phi\n1e6,0,0,0\n',
        'few': 't,x,y,phi\n1,0.5,0.4,1.5\n2,0.5,0.4,1.5\n3,0.5,0.4,1.5\n',
    }
    names = {'bag': case.bag, 'poses': case.poses, 'tmp': tmp_path}
    for name, text in files.items():
        names[name] = tmp_path / f'{name}.csv'
        names[name].write_text(text)
    before = sorted(tmp_path.iterdir())
    capsys.readouterr()
    assert run('calibrate', *(word.format(**names) for word in words)) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1, error
    assert sorted(tmp_path.iterdir()) == before


def test_python_refuses_what_the_command_refuses(case):
    with pytest.raises(InputError, match='override'):
        pr.calibrate(case.bag, poses=case.poses, **{'robot.l1': 1.0})
    with pytest.raises(InputError, match='free must be a list'):
        pr.calibrate(case.bag, poses=case.poses, free='frame')
    with pytest.raises(BagError, match='has no topic of measured poses'):
        pr.calibrate(case.bag)


def framed(pose):
    place = np.exp(0.3j) * (pose[:, 0] + 1j * pose[:, 1]) + (1.0 + 2.0j)
    return np.column_stack([place.real, place.imag, pose[:, 2] + 0.3])


def pointed(pose):
    """The pose of a target 80 mm beside the centre of the platform."""
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return pose + 0.08 * np.column_stack([c, s, 0.0 * c])


@pytest.mark.parametrize(
    ('change', 'cause'),
    [
        (lambda pose: pose * [1e3, 1e3, 1.0], 'lengths in mm'),
        (lambda pose: np.degrees(pose * [0, 0, 1]) + pose * [1, 1, 0], 'angles in degrees'),
        (lambda pose: pose * [-1, -1, 1], 'x, y with the other sign (mirrored?)'),
        (lambda pose: pose * [1, -1, -1], 'y, phi with the other sign (mirrored?)'),
        (lambda pose: pose * [1, -1, 1], 'y with the other sign (mirrored?)'),
        (lambda pose: pose[:, [1, 0, 2]], 'x, y swapped'),
        (framed, 'another frame (--free frame)'),
        (lambda pose: np.add(pose, [0.05, 0.0, 0.0]), 'another frame (--free frame)'),
        (pointed, 'a target beside the tool (--free target)'),
    ],
)
def test_poses_of_something_else_cost_one_line_with_the_cause(
    case, tmp_path, capsys, change, cause
):
    table = np.column_stack([case.table[:, 0], change(case.table[:, 1:])])
    poses, out = tracker(tmp_path / 'poses.csv', 't,x,y,phi', table), tmp_path / 'robot.yaml'
    capsys.readouterr()
    assert run('calibrate', case.bag, '--poses', poses, '--out', out) == 2
    error = capsys.readouterr().err
    assert f'but with {cause} they are' in error and error.count('\n') == 1, error
    assert not out.exists()


def test_a_fit_that_leaves_most_is_no_result(case, tmp_path, capsys):
    """Poses of other times: no geometry, and none of the causes explains them."""
    table = case.table.copy()
    table[:, 1:] = np.random.default_rng(3).permutation(table[:, 1:])
    poses = tracker(tmp_path / 'poses.csv', 't,x,y,phi', table[::20])
    capsys.readouterr()
    assert run('calibrate', case.bag, '--poses', poses, '--out', tmp_path / 'robot.yaml') == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'explains the poses' in error, error
    assert not (tmp_path / 'robot.yaml').exists()


def test_a_signal_in_machine_code_ends_the_command(monkeypatch, capsys):
    """Python tells it as the cause of another error."""

    def interrupted(*_):
        raise SystemError('returned a result with an exception set') from Terminated(15)

    monkeypatch.setattr(bag_calibration, '_calibrated', interrupted)
    assert run('calibrate', 'bag') == 143 and not capsys.readouterr().err
