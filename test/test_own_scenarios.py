"""A file is a scenario in every command and node, and its bag needs the file no more."""

import json

import pytest
import yaml
from bags import content
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from test_command_line import refused

from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import run
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

TEXT = """
base: paper_circle
duration: 0.1
circle:
  radius: 2e-2
robot.m1: 6.0
true_robot.m1: 5.12
s_fotsmc.G: 12.0
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The current directory, with the scenario `mine`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'mine.yaml').write_text(TEXT)
    return tmp_path


def test_its_bag_is_repeated_without_the_file(here, capsys):
    assert main(['simulate', 'mine.yaml', '--out', 'bag']) == 0
    out = capsys.readouterr().out
    assert out.startswith('0.1 s of motion') and '\nmine, s_fotsmc, 0.1 s; ' in out
    log = recording.read(here / 'bag').log
    assert (log.scenario, log.config['circle.radius']) == ('mine', 0.02)
    (here / 'mine.yaml').unlink()
    assert main(['rerun', 'bag']) == 0
    assert 'identical: 382 messages' in capsys.readouterr().out
    again = recording.read(here / 'bag_rerun').log
    assert again.config == log.config and again.scenario == 'mine'
    assert main(['replay', 'bag']) == 0
    assert main(['analyze', 'bag', '--json', 'bag.json']) == 0
    assert json.loads((here / 'bag.json').read_text())['scenario'] == 'mine'


@pytest.mark.parametrize('scenario', ['paper_circle', 'mine.yaml'])
def test_a_true_robot_of_its_own_is_repeated(here, scenario, capsys):
    """Also where only the nominal robot differs from the scenario."""
    words = ['--duration', '0.1', '--set', 'robot.m1=6', '--set', 'true_robot.m1=5.12']
    assert main(['simulate', scenario, *words, '--out', 'bag']) == 0
    assert main(['rerun', 'bag']) == 0
    assert 'identical: ' in capsys.readouterr().out
    assert recording.read(here / 'bag_rerun').log.config == recording.read(here / 'bag').log.config


def test_another_robot_is_repeated(here, capsys):
    (here / 'axes.yml').write_text('base: axes_step\nduration: 0.1\nrobot.upper: 2.5\n')
    assert main(['simulate', 'axes.yml', '--out', 'bag']) == 0
    (here / 'axes.yml').unlink()
    assert main(['rerun', 'bag']) == 0
    assert 'identical: ' in capsys.readouterr().out
    assert recording.read(here / 'bag_rerun').log.config == recording.read(here / 'bag').log.config


@pytest.mark.parametrize(
    ('words', 'duration'),
    [([], 0.1), (['--duration', '0.2'], 0.2), (['--set', 'duration=0.3'], 0.3)],
)
def test_its_duration_counts_unless_another_is_given(here, words, duration):
    assert main(['simulate', 'mine.yaml', *words, '--out', 'bag']) == 0
    assert recording.read(here / 'bag').log.config['duration'] == duration


def test_files_then_words_then_options(here):
    (here / 'one.yaml').write_text('smc.z: 1.0\nsmc.u: 0.5\nlaw: pid\nduration: 0.05\n')
    (here / 'two.yaml').write_text('/**: {ros__parameters: {smc: {z: 21.0}, s_smc.z: 22.0}}\n')
    words = ['--param-file', 'one.yaml', '--param-file', 'two.yaml', '--set', 's_smc.z=23']
    assert main(['simulate', 'mine.yaml', *words, '--law', 'smc', '--out', 'bag']) == 0
    values = recording.read(here / 'bag').log.config
    keys = ('smc.z', 'smc.u', 's_smc.z', 'law', 'duration')
    assert [values[key] for key in keys] == [21.0, 0.5, 23, 'smc', 0.05]
    assert main(['replay', 'bag', '--param-file', 'two.yaml']) == 0


def test_compare_takes_the_name_of_the_file(here, capsys):
    assert main(['compare', './mine.yaml', '--laws', 'smc', '--json', 'table.json']) == 0
    assert capsys.readouterr().out.startswith('mine: ')
    assert json.loads((here / 'table.json').read_text())['scenario'] == 'mine'


@pytest.mark.parametrize('command', ['simulate', 'run', 'compare', 'show'])
@pytest.mark.parametrize(
    ('text', 'words', 'reason'),
    [
        ('circle.radius: [1]\n', [], 'circle.radius must be a number, not [1]'),
        ('circle.radius: yes\n', [], 'circle.radius must be a number, not True'),
        ('realtime: on\n', [], "unknown value of realtime 'True'"),
        ('circle.radius: 1: 2\n', [], 'line 1: not valid YAML'),
        ('base: mine.yaml\n', [], 'lead in a circle'),
        (TEXT, ['--param-file', 'gone.yaml'], 'gone.yaml does not exist'),
        (TEXT, ['--param-file', '.'], '. is not a file'),
        (TEXT, ['--param-file', 'typo.yaml'], "did you mean 'circle.radius'?"),
    ],
)
def test_a_wrong_file_costs_one_line(command, text, words, reason, here, capsys, monkeypatch):
    monkeypatch.setattr(run, '_supervise', lambda *_: pytest.fail('nodes were started'))
    (here / 'mine.yaml').write_text(text)
    (here / 'typo.yaml').write_text('circle.radios: 1\n')
    out = ['--out', 'bag'] if command in ('simulate', 'run') else []
    assert reason in refused([command, 'mine.yaml', *words, *out], capsys)
    assert {path.name for path in here.iterdir()} == {'mine.yaml', 'typo.yaml'}


def test_nodes_are_given_an_absolute_path(here, monkeypatch):
    given = []
    monkeypatch.setattr(run, '_supervise', lambda *words: given.append(words) or 1 / 0)
    (here / 'mine.yaml').write_text(TEXT + 'middleware: default\n')
    (here / 'more.yaml').write_text(
        'scenario: mine\nsmc.z: 21.0\nsubscribers: 9\nrecorder.out: x\n'
    )
    with pytest.raises(ZeroDivisionError):
        main(['run', 'mine.yaml', '--param-file', 'more.yaml', '--out', 'bag'])
    parameters, loop, *_ = given[0]
    assert loop.scenario == 'mine'
    for values in parameters.values():
        assert values['scenario'] == str(here / 'mine.yaml')
        assert (values['middleware'], values['smc.z']) == ('default', 21.0)
        assert 'duration' not in values  # that of the scenario
    assert parameters['recorder']['recorder.out'] == 'bag'
    assert parameters['plant']['subscribers'] < 9


def test_nodes_run_it_in_lockstep(launch, domain, here):
    words = ['mine.yaml', '--time-mode', 'lockstep', '--out', 'bag']
    process = launch('parallel_robot.cli.command_line', 'run', *words)
    assert process.wait() == 0, process.stderr
    (here / 'mine.yaml').unlink()
    log = recording.read(here / 'bag').log
    assert (log.scenario, log.config['circle.radius'], len(log.time)) == ('mine', 0.02, 101)
    process = launch('parallel_robot.cli.command_line', 'rerun', 'bag')
    assert process.wait() == 0, process.stderr
    first, again = (content(next((here / name).glob('*.mcap'))) for name in ('bag', 'bag_rerun'))
    assert first == again


def test_a_node_takes_it_and_what_show_writes(launch, peer, here, capsys):
    assert main(['show', 'mine.yaml', '--set', 'smc.z=21', '--format', 'ros']) == 0
    file = here / 'shown.yaml'
    file.write_text(capsys.readouterr().out)
    node = launch(MODULES['controller'], '--ros-args', '--params-file', file)
    names = ['scenario', 'duration', 's_fotsmc.G', 'smc.z', 'robot.m1']
    request = GetParameters.Request(names=names)
    name, *numbers = peer.call(GetParameters, 'controller/get_parameters', request, node).values
    assert name.string_value == str(here / 'mine.yaml')
    assert [value.double_value for value in numbers] == [0.1, 12.0, 21.0, 6.0]


def dumped(peer, name, node):
    """All parameters of a node that have a value in a parameter file."""
    listed = peer.call(ListParameters, f'{name}/list_parameters', ListParameters.Request(), node)
    request = GetParameters.Request(names=listed.result.names)
    found = peer.call(GetParameters, f'{name}/get_parameters', request, node).values
    values = dict(zip(request.names, map(parameter_value_to_python, found), strict=True))
    values = {key: v if isinstance(v, str) or not hasattr(v, '__iter__') else list(v)
              for key, v in values.items()}  # fmt: skip
    return {key: value for key, value in values.items() if value not in ([], None)}


def test_a_node_is_started_again_with_its_own_parameters(launch, peer, here):
    node = launch(MODULES['trajectory'], '--ros-args', '-p', 'scenario:=mine.yaml')
    values = dumped(peer, 'trajectory', node)
    assert (values['scenario'], values['duration']) == (str(here / 'mine.yaml'), 0.1)
    (here / 'own.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    words = ['--params-file', 'own.yaml', '-r', '__ns:=/again']
    node = launch(MODULES['trajectory'], '--ros-args', *words)
    assert dumped(peer, 'again/trajectory', node) == values


def test_a_node_says_in_one_line_what_is_wrong(launch, domain, here):
    words = ['--ros-args', '-p', 'scenario:=gone.yaml']
    node = launch(MODULES['plant'], *words)
    assert node.wait() == 2
    assert node.stderr == f'parallel_robot: {here / "gone.yaml"} does not exist\n'


@pytest.mark.parametrize(
    ('text', 'line', 'reason'),
    [
        ('circle: {radius: "0.02 m"}', 1, "circle.radius must be a number, not '0.02 m'"),
        ('base: paper_circle\n\ncircle:\n  radius: .nan', 4, 'circle.radius must be finite'),
        ('base: paper_circle\ncircle.radios: 1', 2, "did you mean 'circle.radius'?"),
        ('base: paper_cirle', 1, "unknown base 'paper_cirle'; did you mean 'paper_circle'?"),
        ('period: 0.0010004', 1, 'period must be a whole number of µs'),
        ('duration: -1', 1, 'duration must be at least 0 s'),
        ('law: smk', 1, "unknown law 'smk'; did you mean 'smc_k'?"),
        ('robot_model: axs', 1, "unknown robot_model 'axs'; did you mean 'axes'?"),
        ('estimator.kind: levnat', 1, "did you mean 'levant'?"),
        ('joints: [a, a, b]', 1, 'joints must be different names'),
        ('circle.center: [0.4, a]', 1, "circle.center[1] must be a number, not 'a'"),
        ('circle:\n  center: [0.4]', 2, 'circle.center must be [x, y], or a pose'),
        ('robot:\n  l1: 0.4\n  m1: -1', 3, 'robot.m1 must be positive'),
        ('true_robot.lc1: 7.0', 1, 'true_robot.lc1 must lie on its link'),
        ('plant.initial_pose: [9.0, 9.0, 0.0]', 1, 'plant.initial_pose [9.0, 9.0, 0.0] is out of'),
        ('plant.initial_pose: [9.0]', 1, 'plant.initial_pose must be ['),
        ('controller.guess: [1.0]', 1, 'controller.guess must be empty or'),
        ('trajectory.shape: circel', 1, "did you mean 'circle'?"),
        ('trajectory.shape: excitation\nexcitation:\n  duration: 1\n  blend: 1', 4,
         'excitation.blend must be at most half'),
        ('custom_laws: [a.py]', 1, 'custom_laws is given on a command line alone'),
        ('law: smc\nscenario: other', 2, 'a scenario has the name of its file'),
    ],
)  # fmt: skip
def test_a_mistake_in_a_file_names_file_and_line(here, text, line, reason, capsys):
    (here / 'wrong.yaml').write_text(text)
    assert reason in refused(['simulate', 'wrong.yaml', '--out', 'bag'], capsys)
    (here / 'next.yaml').write_text('base: wrong.yaml\n')
    found = refused(['simulate', 'next.yaml', '--out', 'bag'], capsys)
    assert f': {here / "wrong.yaml"}, line {line}: ' in found and reason in found
    if not text.startswith(('base', 'custom_laws', 'law: smc', 'plant')):
        found = refused(['show', 'paper_circle', '--param-file', 'wrong.yaml'], capsys)
        assert f': wrong.yaml, line {line}: ' in found


def test_a_set_of_gains_names_its_lines(here, capsys):
    (here / 'wrong.yaml').write_text('s_fotsmc:\n  Gamma1: 0.0\n\n  gamma1: 0.5\nsmc.z: 3.0\n')
    found = refused(['simulate', 'wrong.yaml', '--out', 'bag'], capsys)
    assert 'wrong.yaml, lines 2 and 4: s_fotsmc: ' in found


def test_what_wins_over_a_file_is_not_blamed_on_it(here, capsys):
    (here / 'gains.yaml').write_text('smc.z: -1.0\nduration: 0.1\nlaw: smc\n')
    words = ['simulate', 'mine.yaml', '--param-file', 'gains.yaml', '--out', 'bag']
    assert 'gains.yaml, line 1: smc.z must be' in refused(words, capsys)
    assert 'simulate: smc.z must be' in refused([*words, '--set', 'smc.z=-2'], capsys)
    words += ['--set', 'smc.z=2']
    assert 'simulate: duration must be' in refused([*words, '--duration', '-1'], capsys)
    assert "simulate: unknown law 'smk'" in refused([*words, '--law', 'smk'], capsys)
    (here / 'ros.yaml').write_text('/**:\n  ros__parameters:\n    smc:\n      z: [1.0]\n')
    words = ['run', 'paper_circle', '--param-file', 'ros.yaml', '--out', 'bag']
    assert 'ros.yaml, line 4: smc.z must be a number' in refused(words, capsys)
    assert main(['simulate', 'mine.yaml', '--out', 'bag']) == 0
