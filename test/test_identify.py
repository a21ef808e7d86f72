"""The command ``identify``."""

import json
import re
import shutil

import numpy as np
import pytest
import yaml
from bags import STORE, content, full_disk, write_foreign

from parallel_robot.bags import indexed_reader
from parallel_robot.bags.run import recording, run_log, run_windows
from parallel_robot.cli.command_line import main
from parallel_robot.studies.identification import identified, measured_motion
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration import config
from parallel_robot_model.messages.topics import COMMANDS, JOINT_STATES

TRUE = ['--set', 'true_robot.m1=6.0', '--set', 'true_robot.mp=5.5']
MP = 5.5 / 3.0
TRUTH = {  # Table 1 with these masses; the platform on its three joints
    'a + 0.05333 mp': 0.091 + 6.0 * 0.04 + 7.39 * 0.16 + MP * 0.16,
    'b + 0.12 mp': 0.267 + 7.39 * 0.09 + MP * 0.36,
    'h + 0.08 mp': 7.39 * 0.12 + MP * 0.24,
    'Ip - 0.04 mp': 0.065 - 5.5 * 0.04,
}


def run(*words):
    return main([str(word) for word in words])


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """A bag that excites, one to validate with, and one of a robot at rest."""
    directory = tmp_path_factory.mktemp('bags')
    excited, circle, still = (directory / name for name in ('excited', 'circle', 'still'))
    assert run('simulate', 'excitation', '--duration', 15, *TRUE, '--out', excited) == 0
    assert run('simulate', 'paper_circle', '--duration', 6, *TRUE, '--out', circle) == 0
    hold = ['--set', 'trajectory.shape=hold', '--set', 'hold.pose=[0.52,0.37,1.5707963]']
    hold += ['--set', 'plant.initial_pose=[0.52,0.37,1.570796]']
    assert run('simulate', 'paper_circle', '--duration', 2, *hold, '--out', still) == 0
    return excited, circle, still


def test_a_bag_gives_the_true_robot_within_1_percent_as_yaml_and_json(bags, tmp_path, capsys):
    excited, circle, _ = bags
    out, figure = tmp_path / 'robot.yaml', tmp_path / 'torques.png'
    capsys.readouterr()
    words = ['identify', excited, '--validate', circle, '--out', out, '--figure', figure]
    assert run(*words, '--format', 'json') == 0
    found = json.loads(capsys.readouterr().out)
    values = {item['name']: item['estimate'] for item in found['base_parameters']}
    for name, value in TRUTH.items():
        assert abs(values[name] / value - 1.0) < 0.01, name
    for errors in found['torque_error_rms_nm'].values():
        assert errors['identified'] < 0.1 * errors['before']
    assert not found['constraint_active'] and not found['not_told']
    assert figure.read_bytes().startswith(b'\x89PNG')
    # The file is a configuration, and its robot has the true base parameters.
    overrides = config.flat(yaml.safe_load(out.read_text()))
    robot = resolve('paper_circle', overrides)
    a = robot['robot.I1'] + robot['robot.m1'] * robot['robot.lc1'] ** 2
    a += robot['robot.m2'] * 0.4**2 + robot['robot.mp'] / 3.0 * 0.16
    assert abs(a / TRUTH['a + 0.05333 mp'] - 1.0) < 0.01
    assert np.allclose(robot['friction.viscous'], 2.5, rtol=0.01)


def test_the_end_that_was_not_fitted_is_told_first(bags, capsys, monkeypatch):
    """Against a fit to the begin of the bag, by --to, whose end is looked at by --validate."""
    said, judged = [], []
    own = identified.judge

    def judge(found, checked, joints):
        judged.append(checked)
        return own(found, checked, joints)

    monkeypatch.setattr(identified, 'judge', judge)
    for words in ([], ['--hold-out', 0], ['--to', 10, '--hold-out', 0, '--validate', '10.33:15']):
        capsys.readouterr()
        assert run('identify', bags[0], *words, '--format', 'json') == 0
        said.append(json.loads(capsys.readouterr().out))
    assert next(iter(said[0])) == 'held_out' and said[1].pop('held_out') is None
    held = said[0].pop('held_out')
    assert said[0] == said[1]  # the robot is that of all samples
    assert judged[0].share.tolist() == held['share'] and len(held['share']) == 3
    assert 10.3 < held['from_s'] < 10.5 and held['to_s'] > 14.5
    for share, errors in zip(held['share'], said[2]['torque_error_rms_nm'].values(), strict=True):
        assert share == pytest.approx(errors['identified'] / errors['torque'], rel=0.3)
        assert share < 0.01
    assert run('identify', bags[0], '--all') == 0
    assert re.match(
        r'held out, 10.\d to 14.\d s, fitted before: ', capsys.readouterr().out.strip()
    )


def test_an_answer_for_people_has_ten_lines(bags, capsys):
    capsys.readouterr()
    assert run('identify', bags[0]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 10
    assert re.match(r'planar_3rrr: 14.\d s .* from 10.\d s on, which was not fitted', lines[0])
    head, first = (re.split(r'\s{2,}', line.strip()) for line in lines[1:3])
    assert head == ['joint', 'error, %', 'before, %', 'viscous [N m s/rad]', 'dry [N m]']
    assert first[0] == 'joint1' and float(first[1]) < 1.0 < float(first[2])
    assert all(re.fullmatch(r'\S+ \+- \S+', each) for each in first[3:])
    masses = [float(each) for each in re.findall(r'[\d.]+(?= kg| before)', lines[5])]
    assert masses[0] == pytest.approx(3 * (6.0 + 7.39) + 5.5, rel=0.2) and masses[1] < masses[0]


def test_the_table_says_what_a_slow_motion_does_not_tell(bags, capsys):
    capsys.readouterr()
    assert run('identify', bags[1], '--all') == 0
    out = capsys.readouterr().out
    assert 'a + 0.05333 mp' in out and '95 % interval' in out and 'condition number' in out
    assert 'robot.m1' in out and 'same bag' in out


@pytest.mark.parametrize('more', [['--validate'], ['--rest'], ['--from', '2.5']], ids=' '.join)
def test_a_bag_in_windows_gives_the_same(more, bags, capsys, monkeypatch):
    excited, circle, still = bags
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)
    monkeypatch.setattr(measured_motion, 'LONGEST', 4500)
    chunks = recording.chunks

    def with_empty_ones(*given, **options):
        for window in chunks(*given, **options):
            empty = window._replace(log=run_log.head(window.log, 0))
            yield from (empty, window, empty)

    said = []
    for seconds in (100.0, 1.7):
        monkeypatch.setattr(run_windows, 'SECONDS', seconds)
        if seconds < 2.0:
            monkeypatch.setattr(recording, 'chunks', with_empty_ones)
        capsys.readouterr()
        words = [*more, circle] if more == ['--validate'] else more
        bag = still if more == ['--rest'] else excited
        assert run('identify', bag, *words, '--format', 'json') == 0
        said.append(capsys.readouterr())
    assert said[0] == said[1]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['{still}'], 'the robot stood still'),
        (['{still}', '--rest', '--out', '{tmp}/y'], '--rest identifies no robot'),
        (['{tmp}/none'], 'none'),
        (['{excited}', '--validate', '{excited}'], '--validate needs another bag'),
        (
            ['{excited}', '--validate', '5:15'],
            '--validate 5:15 is a part of what is fitted',
        ),
        (['{excited}', '--hold-out', '1.5'], '--hold-out must be from 0 to 0.9, not 1.5'),
        (['{still}', '--rest', '--hold-out', '0.2'], '--rest identifies no robot: no --hold-out'),
        (['{excited}', '--validate', '{still}'], 'the robot stood still'),
        (['{excited}', '--cutoff', 'nan'], '--cutoff must be a frequency in Hz, not nan'),
        (['{excited}', '--cutoff', '0'], '--cutoff must be positive and at most 100 Hz'),
        (['{excited}', '--cutoff', '0.2'], 'too little motion to identify a robot'),
        (['{excited}', '--figure', '{tmp}/x.txt'], "unknown picture format '.txt'"),
        (['{excited}', '--out', '/dev/null/where.yaml'], 'cannot write'),
        (['{excited}', '--set', 'law=pid'], 'law=pid would change; --override permits that'),
        ([], 'takes either a bag or --design SCENARIO'),
        (['{excited}', '--design', 'excitation'], 'takes either a bag or --design SCENARIO'),
        (['--design', 'excitation'], '--design needs --out FILE'),
        (['--design', 'excitation', '--out', '{tmp}/y', '--trials', '0'], '--trials must be'),
        (['--design', 'paper_circle', '--out', '{tmp}/y'], '--design needs trajectory.shape'),
        (['--design', 'exitation', '--out', '{tmp}/y'], "did you mean 'excitation'?"),
    ],
)
def test_what_is_wrong_costs_one_line(bags, tmp_path, capsys, words, message):
    excited, _, still = bags
    names = {'still': still, 'excited': excited, 'tmp': tmp_path}
    capsys.readouterr()
    assert run('identify', *(word.format(**names) for word in words)) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_a_robot_that_only_rests_tells_its_noise(tmp_path, capsys):
    bag, noise = tmp_path / 'noisy', ['--set', 'sensor.position_noise=2e-5']
    hold = ['--set', 'trajectory.shape=hold', '--set', 'actuator.effectiveness=0.0']
    assert run('simulate', 'paper_circle', '--duration', 2, *hold, *noise, '--out', bag) == 0
    capsys.readouterr()
    assert run('identify', bag, '--rest', '--format', 'json') == 0
    found = json.loads(capsys.readouterr().out)['rest']
    np.testing.assert_allclose(found['position_noise_rad'], 2e-5, rtol=0.1)
    assert run('identify', bag, '--rest') == 0
    assert 'estimator.position_noise: [' in capsys.readouterr().out


def test_nothing_is_overwritten(bags, tmp_path, capsys):
    out = tmp_path / 'robot.yaml'
    out.write_text('mine')
    assert run('identify', bags[0], '--out', out) == 2
    assert 'exists; nothing is overwritten' in capsys.readouterr().err
    assert out.read_text() == 'mine'


def test_another_robot_does_not_validate(bags, tmp_path, capsys):
    other = tmp_path / 'other'
    assert run('simulate', 'paper_circle', '--duration', 1, '--set', 'robot.l3=0.19',
               '--out', other) == 0  # fmt: skip
    capsys.readouterr()
    assert run('identify', bags[0], '--validate', other) == 2
    assert 'a bag of the same robot: robot.l3 is 0.19, not 0.2' in capsys.readouterr().err
    shutil.rmtree(other)


def test_a_designed_motion_is_feasible_and_repeatable(tmp_path, capsys):
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    words = ['identify', '--design', 'serial_2r_circle', '--set', 'trajectory.shape=excitation']
    for out in (first, second):
        assert run(*words, '--trials', 3, '--seed', 5, '--out', out) == 0
    assert first.read_text() == second.read_text()
    assert 'condition number' in capsys.readouterr().out
    overrides = config.flat(yaml.safe_load(first.read_text()))
    bag = tmp_path / 'bag'
    sets = [word for key, value in overrides.items() for word in ('--set', f'{key}={value}')]
    shape = ['--set', 'trajectory.shape=excitation']
    words = ['simulate', 'serial_2r_circle', *shape, *sets, '--duration', 1, '--out', bag]
    assert run(*words) == 0


def test_a_full_disk_is_no_wrong_option(tmp_path, capsys):
    """The status is that of a run that fails, as of any other file that a command writes."""
    out = tmp_path / 'motion.yaml'
    words = ['identify', '--design', 'excitation', '--trials', 1, '--out', out]
    assert run(*words) == 0  # nothing is compiled from here on
    out.unlink()
    capsys.readouterr()
    with full_disk(10):
        assert run(*words) == 1
    assert f'cannot write {out}: File too large' in capsys.readouterr().err
    assert not out.exists()


NOISE = {'position': 2e-5, 'velocity': 4e-3}


def test_the_noise_of_the_sensors_is_measured_at_rest_and_goes_into_the_file(tmp_path, capsys):
    """The excitation ends at rest; the controller goes on, so the robot moves a little."""
    bag, out = tmp_path / 'bag', tmp_path / 'robot.yaml'
    sets = [
        word
        for name, value in NOISE.items()
        for word in ('--set', f'sensor.{name}_noise=[{value:f},{2 * value:f},{value:f}]')
    ]
    words = ['simulate', 'excitation', '--duration', 16, '--law', 'computed_torque']
    assert run(*words, *sets, '--out', bag) == 0
    capsys.readouterr()
    assert run('identify', bag, '--out', out) == 0
    said = capsys.readouterr().out
    values = resolve('paper_circle', config.flat(yaml.safe_load(out.read_text())))
    for name, value in NOISE.items():
        key = f'estimator.{name}_noise'
        assert f'  {key}: {values[key]}' in said
        assert np.allclose(values[key], [value, 2 * value, value], rtol=0.1), key


def test_without_noise_or_rest_nothing_is_said_of_the_sensors_in_the_file(bags, tmp_path, capsys):
    capsys.readouterr()
    assert run('identify', bags[1], '--format', 'json') == 0
    assert json.loads(capsys.readouterr().out)['rest'] is None
    assert run('identify', bags[1], '--all', '--out', tmp_path / 'robot.yaml') == 0
    assert 'no phase of rest of 0.1 s' in capsys.readouterr().out
    assert 'estimator' not in yaml.safe_load((tmp_path / 'robot.yaml').read_text())


def altered(bag, directory, change, kept=(JOINT_STATES, COMMANDS)):
    """The bag as another recorder has it, with other efforts."""
    [file] = bag.glob('*.mcap')
    found = content(file)
    streams = {topic: found[topic.name] for topic in kept}
    states = []
    for stamp, data in streams[JOINT_STATES]:
        message = STORE.deserialize_cdr(data, JOINT_STATES.type)
        message.effort = np.r_[change(message.effort[:3]), message.effort[3:]]
        states.append((stamp, bytes(STORE.serialize_cdr(message, JOINT_STATES.type))))
    write_foreign(directory, streams | {JOINT_STATES: states})
    return directory


@pytest.mark.parametrize(
    ('change', 'kept', 'message'),
    [
        (lambda e: 0.1 * e, (JOINT_STATES, COMMANDS), 'efforts are 0.1 of the commands'),
        (lambda e: 1000 * e, (JOINT_STATES, COMMANDS), 'are they in mN m?'),
        (lambda e: 1000 * e, (JOINT_STATES,), 'more than plant.torque_limit, 200 N m: are they'),
        (lambda e: -e, (JOINT_STATES, COMMANDS), 'are -1 of the commands: is a sign wrong?'),
        (lambda e: -e, (JOINT_STATES,), 'those of joint1, joint2, joint3 have the sign of the'),
        (lambda e: e[[1, 0, 2]], (JOINT_STATES,), 'in the order joint2, joint1, joint3'),
        (lambda e: e * [1, 1, -1], (JOINT_STATES,), 'those of joint3 have the sign of the'),
    ],
)
def test_efforts_that_are_no_torques_are_refused(bags, tmp_path, capsys, change, kept, message):
    bag = altered(bags[0], tmp_path / 'bag', change, kept)
    capsys.readouterr()
    assert run('identify', bag, '--out', tmp_path / 'robot.yaml') == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1, error
    assert not (tmp_path / 'robot.yaml').exists()


@pytest.mark.parametrize('lacking', ['velocity', 'effort'])
def test_joint_states_alone_need_no_velocities_but_efforts(bags, tmp_path, capsys, lacking):
    [file] = bags[0].glob('*.mcap')
    states = []
    for stamp, data in content(file)[JOINT_STATES.name]:
        message = STORE.deserialize_cdr(data, JOINT_STATES.type)
        setattr(message, lacking, np.zeros(0))
        states.append((stamp, bytes(STORE.serialize_cdr(message, JOINT_STATES.type))))
    write_foreign(tmp_path / 'bag', {JOINT_STATES: states})
    capsys.readouterr()
    code = run('identify', tmp_path / 'bag', '--scenario', 'excitation')
    error = capsys.readouterr().err
    if lacking == 'velocity':
        assert code == 0 and 'have no velocities' in error
    else:
        assert code == 2 and 'torques are needed: joint states have no efforts' in error


def test_torques_that_are_a_tenth_of_those_of_the_robot_are_doubted(bags, tmp_path, capsys):
    bag = altered(bags[0], tmp_path / 'bag', lambda e: 0.1 * e, (JOINT_STATES,))
    capsys.readouterr()
    assert run('identify', bag) == 0
    assert '0.11 of those of the robot of the configuration: are the' in capsys.readouterr().err


def test_a_motor_that_gives_less_has_no_lag_by_that(bags, tmp_path, capsys):
    bag = altered(bags[0], tmp_path / 'bag', lambda e: 0.8 * e)
    capsys.readouterr()
    assert run('identify', bag) == 0
    out, err = capsys.readouterr()
    assert 'efforts are 0.8 of the commands' in err
    assert 'efforts follow the commands without a lag' in out


def test_per_cent_are_those_of_the_estimate(bags, capsys):
    """With a guess a hundredth of the truth, what is known is known as well."""
    light = [f'robot.{key}=0.01' for key in ('m1', 'm2', 'mp', 'I1', 'I2', 'Ip')]
    words = [word for value in light for word in ('--set', value)]
    capsys.readouterr()
    assert run('identify', bags[0], '--override', *words, '--all') == 0
    out = capsys.readouterr().out
    assert 'the motion does not tell' not in out
    [row] = [line for line in out.splitlines() if line.strip().startswith('a + ')]
    estimate, half, share = re.search(r'  ([\d.]+) +\+- (\S+) \((\S+) %\)', row).groups()
    assert float(share) == pytest.approx(100.0 * float(half) / float(estimate), rel=0.06)
