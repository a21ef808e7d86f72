"""The command line: one clear line for bad input, and the results that were asked for."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from assembly import simulated
from bags import full_disk, motion_of

from parallel_robot.analysis import metrics
from parallel_robot.analysis.metrics import TABLE
from parallel_robot.analysis.report import figures, runs
from parallel_robot.bags.experiment import software
from parallel_robot.bags.run import bag_difference, recording
from parallel_robot.bags.writing import recovery, simulation_bag
from parallel_robot.cli.command_line import COMMANDS, main, module_of
from parallel_robot.cli.commands import run, simulate
from parallel_robot_model.common.options import Parser
from parallel_robot_model.configuration import config

CIRCLE = ['paper_circle', '--duration', '0.2']


def refused(words, capsys):
    """Run a command that must be refused; return its line."""
    assert main([str(word) for word in words]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.startswith(f'parallel_robot {words[0]}: ')
    assert err.count('\n') == 1 and err.endswith('\n') and len(err) < 600
    return err


def setting(assignment):
    return [*CIRCLE, '--set', assignment]


BAD = {
    'unknown scenario': (
        ['paper_circel'],
        "unknown scenario 'paper_circel'; did you mean 'paper_circle'?",
    ),
    'scenario as a path': (['../defaults'], '/defaults does not exist'),
    'unknown law': (
        [*CIRCLE, '--law', 's_fotsmk'],
        "unknown law 's_fotsmk'; did you mean 's_fotsmc'?",
    ),
    'unknown key': (setting('s_fotsmc.lamda=1'), "did you mean 's_fotsmc.lambda'?"),
    'text for a number': (setting('s_fotsmc.G=many'), "s_fotsmc.G must be a number, not 'many'"),
    'truth for a number': (
        setting('circle.radius=true'),
        'circle.radius must be a number, not True',
    ),
    'nothing for a number': (
        setting('circle.radius='),
        'circle.radius must be a number, not None',
    ),
    'number for text': (setting('law=5'), 'law must be'),
    'unknown choice': (setting('plant.integrator=ode5'), "did you mean 'ode3'?"),
    'NaN': (setting('s_fotsmc.g=.nan'), 's_fotsmc.g must be finite'),
    'infinite': (setting('friction.smoothing=.inf'), 'friction.smoothing must be finite'),
    'NaN in a list': (setting('circle.center=[0.5, .nan]'), 'circle.center[1] must be finite'),
    'list too short': (
        setting('plant.initial_pose=[0.5, 0.4]'),
        'plant.initial_pose must be [x, y, phi], not [0.5, 0.4]',
    ),
    'guess too short': (setting('controller.guess=[0.5, 0.4]'), 'controller.guess'),
    'guess of text': (setting('controller.guess=[a, b, c]'), 'controller.guess'),
    'negative mass': (setting('robot.m1=-1'), 'robot.m1'),
    'period out of range': (setting('period=1'), 'period must be from 0.0001 to 0.1 s'),
    'two joints of one name': (
        setting('joints=[a, a, b]'),
        "joints must be different names, not ['a', 'a', 'b']",
    ),
    'no equals sign': (setting('period'), "--set takes KEY=VALUE, not 'period'"),
    'broken YAML': (setting('joints=[a'), '--set joints'),
    'NaN duration': (['paper_circle', '--duration', 'nan'], 'duration must be finite'),
    'no duration': (['paper_circle', '--duration', '0'], 'duration must be positive'),
    'negative duration': (['paper_circle', '--duration', '-1'], 'duration must be at least 0 s'),
    'unreachable start': (setting('plant.initial_pose=[3, 3, 0]'), 'plant.initial_pose'),
    'unreachable motion': (setting('circle.center=[3, 3]'), 'motion refused at t = 0.000 s, leg'),
    'impossible motion': (
        [*setting('circle.radius=0.6'), '--duration', '6'],
        'motion refused at t = ',
    ),
}


@pytest.mark.parametrize('command', ['simulate', 'run'])
@pytest.mark.parametrize('name', BAD)
def test_bad_input_costs_one_line_and_leaves_nothing(command, name, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(run, '_supervise', lambda *_: pytest.fail('nodes were started'))
    words, message = BAD[name]
    assert message in refused([command, *words, '--out', tmp_path / 'deep' / 'bag'], capsys)
    assert not list(tmp_path.iterdir())


def test_a_simulation_too_long_for_the_memory(tmp_path, capsys):
    words = ['simulate', 'paper_circle', '--duration', '1e9', '--out', tmp_path / 'bag']
    assert 'duration' in refused(words, capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('command', ['simulate', 'run'])
@pytest.mark.parametrize('out', ['.', 'file', 'file/bag', 'x' * 300])
def test_an_output_that_cannot_be_made(command, out, tmp_path, capsys):
    (tmp_path / 'file').write_text('mine')
    refused([command, *CIRCLE, '--out', tmp_path / out], capsys)
    assert list(tmp_path.iterdir()) == [tmp_path / 'file']
    assert (tmp_path / 'file').read_text() == 'mine'


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('commands') / 'bag'
    assert main(['simulate', *CIRCLE, '--out', str(directory)]) == 0
    return directory


@pytest.mark.parametrize(
    ('path', 'reason'),
    [
        ('nothing', 'nothing does not exist'),
        ('file', 'nothing in it is MCAP'),
        ('file/bag', 'file/bag does not exist'),
        ('.', 'is not a bag: no MCAP file there'),
    ],
)
def test_a_bag_that_is_none(path, reason, tmp_path, capsys):
    (tmp_path / 'file').write_text('mine')
    assert reason in refused(['analyze', tmp_path / path], capsys)
    assert list(tmp_path.iterdir()) == [tmp_path / 'file']


@pytest.mark.parametrize(
    'words',
    [
        ['--json', '/dev/null/run.json'],
        ['--json', '.'],
        ['--figure', '/dev/null/run.png'],
        ['--figure', 'run.doc'],
        ['--json', 'new/run.json', '--figure', '/dev/null/run.png'],
    ],
    ids=' '.join,
)
def test_results_that_cannot_be_written(words, bag, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(['analyze', bag, *words], capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('words', [[], ['--set', 'true_robot.l1=0.4001']])
def test_simulate_ends_with_the_metrics_of_analyze(words, tmp_path, capsys):
    out = tmp_path / 'a bag'
    assert main(['simulate', 'paper_circle', '--duration', '1', *words, '--out', str(out)]) == 0
    _, head, *brief, place, following = capsys.readouterr().out.splitlines()
    assert len(brief) == (5 if words else 4) and place == f'bag     {out}'
    assert following == f"next    parallel_robot analyze '{out}'"
    assert main(shlex.split(following)[2:]) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    assert head == first
    told = len([one for one in TABLE if one.short and one.group != 'transient'])
    told += 3 if words else 0  # what is seen of the end effector
    metrics_of_bag = [re.sub(r'  +', ' ', line.strip()) for line in lines[:told]]
    assert '; '.join(line.strip() for line in brief) == '; '.join(metrics_of_bag)


def test_a_bag_is_good_though_its_metrics_fail(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(metrics, 'evaluate', lambda *_: 1 / 0)
    assert main(['simulate', *CIRCLE, '--out', str(tmp_path / 'bag')]) == 0
    out, err = capsys.readouterr()
    assert not err and 'no metrics: ZeroDivisionError: division by zero\nbag ' in out
    assert not recording.read(tmp_path / 'bag').log.warnings


def test_simulate_does_not_wait_for_what_it_does_not_use():
    code = 'import sys, parallel_robot.cli.commands.simulate; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    slow = {'scipy.ndimage', 'matplotlib', 'plotly', 'rclpy', 'pandas'}
    assert not slow & {*done.stdout.split()}


def test_simulate_and_analyze(tmp_path, capsys):
    bag, report = tmp_path / 'new' / 'bag', tmp_path / 'report.json'
    assert main(['simulate', 'paper_circle', '--duration', '4', '--out', str(bag)]) == 0
    assert str(bag) in capsys.readouterr().out
    assert main(['analyze', str(bag), '--json', str(report)]) == 0
    assert (bag / 'run.png').read_bytes().startswith(b'\x89PNG')
    found = json.loads(report.read_text())
    keys = ['scenario', 'law', 'duration_s', 'transient', 'steady', 'torque', 'effort']
    keys += ['window', 'timing', 'messages']
    assert list(found) == keys
    assert found['window'] == {'start_s': 2.0, 'stop_s': 4.0, 'run_s': 4.0}
    assert (found['scenario'], found['law'], found['duration_s']) == (
        'paper_circle',
        's_fotsmc',
        4.0,
    )
    of_tool = {'xy_rms_m', 'xy_max_m', 'rotation_rms_rad', 'rotation_max_rad'}
    assert set(found['steady']) == {*of_tool, 'joint_rms_rad', 'sync_rms_rad'}
    assert set(found['torque']) == {'max_nm', 'total_variation_nm_per_s', 'chattering_nm'}
    assert set(found['effort']) == {'torque_rms_nm', 'energy_j', 'excess_chattering_nm'}
    assert 0.0 < found['steady']['xy_rms_m'] < 1e-4 and 1.0 < found['torque']['max_nm'] < 20.0
    assert found['steady']['xy_rms_m'] <= found['steady']['xy_max_m']
    assert found['messages']['joint_states'] == {'count': 4001, 'missing': 0}
    assert found['messages']['controller/error'] == {'count': 401, 'missing': 0}
    out, err = capsys.readouterr()
    assert err == '' and f'{found["steady"]["xy_rms_m"] * 1e6:.3f}  µm' in out
    for name, count in found['messages'].items():
        assert [name, str(count['count']), '0'] in map(str.split, out.splitlines())


def test_a_path_may_be_a_text(bag, tmp_path):
    copy, picture = str(tmp_path / 'copy'), str(tmp_path / 'run.png')
    recovery.recover(str(bag), copy)
    log = recording.read(copy).log
    assert recording.read(copy).history.facts == recording.read(bag).history.facts
    count, _ = bag_difference.compare(bag, tmp_path / 'copy')
    assert bag_difference.compare(str(bag), copy) == (count, '')
    figures.draw_run(log, motion_of(log), picture)
    values = config.resolve('paper_circle', {'duration': 0.01})
    simulation_bag.write(str(tmp_path / 'new'), values, [simulated(values)])
    assert {path.name for path in tmp_path.iterdir()} == {'copy', 'new', 'run.png'}
    assert list(runs.read_runs([copy])) == ['paper_circle']


def test_settings_are_used_and_recorded(bag, tmp_path):
    other = tmp_path / 'bag'
    words = [
        '--set',
        's_fotsmc.G=1e1',
        '--set',
        'friction.coulomb=[0, 5e-1, 1]',
        '--law',
        's_fotsmc',
    ]
    assert main(['simulate', *CIRCLE, *words, '--out', str(other)]) == 0
    log = recording.read(other).log
    assert log.config['friction.coulomb'] == [0, 0.5, 1] and log.config['s_fotsmc.G'] == 10.0
    assert not (log.position == recording.read(bag).log.position).all()


@pytest.mark.parametrize(
    ('word', 'hint'),
    [
        ('anlyze', "'anlyze'; did you mean 'analyze'? (known: a"),
        ('replai', "'replai'; did you mean 'replay'? (known: a"),
        ('zzz', "'zzz' (known: a"),
    ],
)
def test_an_unknown_command_names_the_nearest(word, hint, capsys):
    assert main([word, '--out', 'x']) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.startswith(f'parallel_robot: unknown command {hint}')
    assert err.count('\n') == 1


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit, match='0'):
        main(['--help'])
    out = capsys.readouterr().out
    assert all(name in out for name in ('run', 'simulate', 'analyze'))


@pytest.mark.parametrize(
    ('assignment', 'message'),
    [
        ('hold.pose=nonsense', 'hold.pose must be a list of numbers'),
        ('pid.Kp=.nan', 'pid.Kp must be finite'),
        (
            'period=0.0010004',
            'period must be a whole number of µs, e.g. 0.001, 0.004, not 0.0010004',
        ),
        ('duration=1e-9', 'duration must be at least one period, 0.001 s, not 1e-09'),
        ('seed=010', '010 is octal for YAML, 8; write 8 or 10'),
    ],
)
def test_keys_that_are_not_used_are_checked_too(assignment, message, tmp_path, capsys):
    out = tmp_path / 'bag'
    words = ['simulate', 'paper_circle', '--set', assignment, '--out', str(out)]
    assert main(words) == 2 and not out.exists()
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_run_refuses_the_keys_it_owns(tmp_path, capsys):
    words = ['run', 'paper_circle', '--set', 'start_stamp=5', '--out', str(tmp_path / 'bag')]
    assert main(words) == 2
    assert 'start_stamp is set by run itself' in capsys.readouterr().err


def test_a_very_slow_motion_is_checked_in_bounded_memory(tmp_path):
    words = ['simulate', 'paper_circle', '--duration', '0.01', '--set', 'circle.rate=1e-300']
    assert main([*words, '--out', str(tmp_path / 'bag')]) == 0


def test_a_full_disk_ends_a_simulation_in_one_line(tmp_path, capsys):
    with full_disk(500_000):
        assert main(['simulate', 'paper_circle', '--out', str(tmp_path / 'bag')]) == 1
    out, err = capsys.readouterr()
    assert out == '' and err == (
        f'parallel_robot simulate: cannot write {tmp_path / "bag"}: File too large\n'
    )
    log = recording.read(tmp_path / 'bag').log
    assert len(log.warnings) == 1 and log.messages['joint_states'].missing == 0
    with full_disk(200_000):
        assert main(['recover', str(tmp_path / 'bag'), '--out', str(tmp_path / 'again')]) == 1
    assert not (tmp_path / 'again').exists()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ('simulate x --out y --duration 12s', "--duration: a number is wanted, not '12s'; did you "
         'mean 12?'),
        ('simulate x --out y --duration 1,5', "a number is wanted, not '1,5'; did you mean 1.5?"),
        ('compare x --duration soon', "--duration: a number is wanted, not 'soon'"),
        ('rerun x --duration 1h', "not '1h'; did you mean 1?"),
        ('simulate x --out y --row 3.0', "--row: a whole number is wanted, not '3.0'; did "
         'you mean 3?'),
        ('sweep x --out y --runs 1e3', "not '1e3'; did you mean 1000?"),
        ('sweep x --out y --workers 1.5', "--workers: a whole number is wanted, not '1.5'"),
        ('tune smc x --out y --trials many', "--trials: a whole number is wanted, not 'many'"),
        ('tune smc x --out y --chattering low', "--chattering: a number is wanted, not 'low'"),
        ('identify x --cutoff 5Hz', "--cutoff: a number is wanted, not '5Hz'; did you mean 5?"),
        ('run x --out y --time-mode lokstep', "--time-mode: unknown value 'lokstep'; did you mean "
         "'lockstep'? (known: lockstep, wall)"),
        ('show x --format jsno', "--format: unknown value 'jsno'; did you mean 'json'?"),
        ('identify x --format jsno', "--format: unknown value 'jsno'; did you mean 'json'?"),
        ('simulate x --out y --durration 3', "unknown option '--durration'; did you "
         "mean '--duration'?"),
        ('simulate x --out y --durration=3', "unknown option '--durration'; did you "
         "mean '--duration'?"),
        ('simulate x', 'the following arguments are required: --out; '),
        ('simulate x --out', '--out: expected one argument'),
        ('analyze x y', 'unrecognized arguments: y; '),
        ('tune smc x --out y --pick 1 --chattering 2', 'not allowed with argument --pick'),
    ],
)  # fmt: skip
def test_a_wrong_option_costs_one_line_that_says_what_is_right(words, message, capsys):
    words = words.split()
    assert main(words) == 2
    out, err = capsys.readouterr()
    start = f'parallel_robot {words[0]}: '
    assert out == '' and err.startswith(start) and err.count('\n') == 1
    assert message in err and 'usage' not in err


def test_every_option_with_a_number_says_what_is_wanted(capsys):
    """Also one that comes later."""
    for command in COMMANDS:
        parser = Parser()
        module_of(command).add_arguments(parser)
        for action in parser._actions:
            if action.type in (int, float):
                assert main([command, action.option_strings[-1], '?']) == 2
                assert 'number is wanted, not' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ('.venv/bin/parallel_robot', '.venv/bin/parallel_robot'),
        ('/on/the/path/parallel_robot', 'parallel_robot'),
        ('/opt/suite/lib/parallel_robot/parallel_robot', 'ros2 run parallel_robot parallel_robot'),
        ('/x/parallel_robot/__main__.py', 'python -m parallel_robot'),
        ('/usr/bin/pytest', 'parallel_robot'),
    ],
)
def test_the_next_command_is_named_as_this_one_was_started(given, words, monkeypatch):
    monkeypatch.setattr('sys.argv', [given, 'simulate'])
    monkeypatch.setattr('shutil.which', lambda _: '/on/the/path/parallel_robot')
    found = simulate.result(Path('runs/a'), lambda: [])
    assert found.endswith(f'next    {words} analyze runs/a')


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit, match='0'):
        main(['--version'])
    facts = software()
    revision = f', revision {facts["revision"]}' if 'revision' in facts else ''
    assert capsys.readouterr().out == f'parallel_robot {facts["version"]}{revision}\n'


@pytest.mark.parametrize(
    ('key', 'near'), [('smc_z', 'smc.z'), ('s_smc_z', 's_smc.z'), ('s-fotsmc.G', 's_fotsmc.G')]
)
def test_a_key_with_another_separator_is_that_key(key, near, capsys):
    assert main(['show', 'paper_circle', '--set', f'{key}=1']) == 2
    assert f"unknown parameter '{key}'; did you mean '{near}'?" in capsys.readouterr().err
