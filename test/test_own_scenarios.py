"""A file is a scenario in every command and node, and its bag needs the file no more."""

import json

import pytest
import yaml
from bags import content
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from test_command_line import refused

from parallel_robot_analysis.command_line import main
from parallel_robot_analysis.commands import run
from parallel_robot_analysis.processes import MODULES
from parallel_robot_bags import run_log

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
    log = run_log.read(here / 'bag')
    assert (log.scenario, log.config['circle.radius']) == ('mine', 0.02)
    (here / 'mine.yaml').unlink()
    assert main(['rerun', 'bag']) == 0
    assert 'identical: 382 messages' in capsys.readouterr().out
    again = run_log.read(here / 'bag_rerun')
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
    assert run_log.read(here / 'bag_rerun').config == run_log.read(here / 'bag').config


def test_another_robot_is_repeated(here, capsys):
    (here / 'axes.yml').write_text('base: axes_step\nduration: 0.1\nrobot.upper: 2.5\n')
    assert main(['simulate', 'axes.yml', '--out', 'bag']) == 0
    (here / 'axes.yml').unlink()
    assert main(['rerun', 'bag']) == 0
    assert 'identical: ' in capsys.readouterr().out
    assert run_log.read(here / 'bag_rerun').config == run_log.read(here / 'bag').config


@pytest.mark.parametrize(
    ('words', 'duration'),
    [([], 0.1), (['--duration', '0.2'], 0.2), (['--set', 'duration=0.3'], 0.3)],
)
def test_its_duration_counts_unless_another_is_given(here, words, duration):
    assert main(['simulate', 'mine.yaml', *words, '--out', 'bag']) == 0
    assert run_log.read(here / 'bag').config['duration'] == duration


def test_files_then_words_then_options(here):
    (here / 'one.yaml').write_text('smc.z: 1.0\nsmc.u: 0.5\nlaw: pid\nduration: 0.05\n')
    (here / 'two.yaml').write_text('/**: {ros__parameters: {smc: {z: 21.0}, s_smc.z: 22.0}}\n')
    words = ['--param-file', 'one.yaml', '--param-file', 'two.yaml', '--set', 's_smc.z=23']
    assert main(['simulate', 'mine.yaml', *words, '--law', 'smc', '--out', 'bag']) == 0
    values = run_log.read(here / 'bag').config
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
    parameters, loop, _ = given[0]
    assert loop.scenario == 'mine'
    for values in parameters.values():
        assert values['scenario'] == str(here / 'mine.yaml')
        assert (values['middleware'], values['smc.z']) == ('default', 21.0)
        assert 'duration' not in values  # that of the scenario
    assert parameters['recorder']['recorder.out'] == 'bag'
    assert parameters['plant']['subscribers'] < 9


@pytest.mark.xdist_group('processes')
def test_nodes_run_it_in_lockstep(launch, domain, here):
    words = ['mine.yaml', '--time-mode', 'lockstep', '--out', 'bag']
    process = launch('parallel_robot_analysis.command_line', 'run', *words)
    assert process.wait() == 0, process.stderr
    (here / 'mine.yaml').unlink()
    log = run_log.read(here / 'bag')
    assert (log.scenario, log.config['circle.radius'], len(log.time)) == ('mine', 0.02, 101)
    process = launch('parallel_robot_analysis.command_line', 'rerun', 'bag')
    assert process.wait() == 0, process.stderr
    first, again = (content(next((here / name).glob('*.mcap'))) for name in ('bag', 'bag_rerun'))
    assert first == again


@pytest.mark.xdist_group('processes')
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


@pytest.mark.xdist_group('processes')
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
