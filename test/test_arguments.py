"""The command line of every node: its help, and words that nobody knows."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy

from parallel_robot_model.configuration import config
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
NODES = {
    **MODULES,
    'player': 'parallel_robot.bags.player_node',
    'monitor': 'parallel_robot.analysis.monitor_node',
}


@pytest.fixture
def node(handlers, monkeypatch, tmp_path, capsys):
    """Run a node in this process; it must neither start rclpy nor leave anything behind."""

    def node(name, *words):
        monkeypatch.setattr(sys, 'argv', [name, *words])
        try:
            code = importlib.import_module(NODES[name]).main()
        except SystemExit as end:
            code = end.code
        assert not list(tmp_path.iterdir())
        return code, *capsys.readouterr()

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rclpy, 'init', lambda **_: pytest.fail('rclpy was started'))
    return node


@pytest.mark.parametrize('name', NODES)
def test_help_says_what_a_node_is_and_starts_nothing(name, node):
    code, out, err = node(name, '--help')
    assert (code, err) == (0, '')
    assert out.startswith(f'usage: {name} ') and 'Node that ' in out
    assert 'docs/parameters.md' in out
    (example,) = (line for line in out.splitlines() if line.startswith('  ros2 run '))
    assert example.startswith(f'  ros2 run parallel_robot {name} ') and '--ros-args -' in example
    assert {*re.findall(r'-p (\S+):=', example)} <= config.resolve('paper_circle').keys()
    assert out.count('ros2 run parallel_robot parallel_robot\n') == 1  # the command line


@pytest.mark.parametrize('name', NODES)
def test_a_word_that_nobody_knows_costs_one_line(name, node):
    own = ['bag'] if name == 'player' else []
    code, out, err = node(name, *own, '--ros-args', '-p', 'a:=1', '--', '--rte')
    assert (code, out) == (2, '') and err.count('\n') == 1
    assert "unknown option '--rte'" in err


@pytest.mark.parametrize('name', ['recorder', 'player'])
@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--foo'], "unknown ROS arguments ['--foo']"),
        (['-p', 'a'], "Couldn't parse parameter override rule: '-p a'"),
    ],
)
def test_wrong_words_for_ros_cost_one_line(name, words, message, node):
    code, out, err = node(name, '--ros-args', *words)
    assert (code, out) == (2, '') and err.count('\n') == 1 and message in err


@pytest.mark.parametrize(
    'words',
    [[NODES['recorder']], ['parallel_robot.cli.command_line', 'node', 'recorder']],
    ids=['module', 'command of the scripts'],
)
def test_processes_give_help(words, tmp_path):
    done = subprocess.run(
        [sys.executable, '-m', *words, '-h', '--ros-args', '-p', 'recorder.out:=bag'],
        cwd=tmp_path,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300.0,
    )
    assert done.returncode == 0 and done.stderr == '' and not list(tmp_path.iterdir())
    assert done.stdout.startswith('usage: recorder [-h]') and 'records to a bag' in done.stdout
