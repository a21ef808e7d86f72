"""What reading a machine left out reaches whoever reads it: once, shortly, beside results."""

import json
import sys

import pytest
from machine_files import urdf

import parallel_robot
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import DescriptionWarning
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.robots import registry

pytest_plugins = ['ros_fixtures']
LEFT_OUT = 'odd: left out: <gizmo> of <robot>, line 34'
STRONG = 'effort="1e6" velocity="9"'
MORE = 'odd: 2 more; parallel_robot robot FILE tells all'


def _strong(text):
    """With limits that hold its weight."""
    for limits in ('effort="50" velocity="3"', 'effort="0" velocity="0"'):
        text = text.replace(limits, STRONG)
    return text


@pytest.fixture
def odd(tmp_path):
    """A file of which five things must be told, as if none had been."""
    registry._warn.cache_clear()
    text = _strong(urdf('<gizmo/><link name="stand"/>')).replace('lower="-1"', 'lower="-180"')
    file = tmp_path / 'odd.urdf'
    file.write_text(text.replace('<mass value="2"/>', '<mass value="20000"/>'))
    yield file
    registry._warn.cache_clear()


def test_a_command_tells_it_once_beside_its_results(odd, capsys):
    assert main(['show', str(odd), '--format', 'json']) == 0
    shown = capsys.readouterr()
    lines = shown.err.splitlines()
    assert f'warning: {LEFT_OUT}' in lines and lines[-1] == f'warning: {MORE}' and len(lines) == 4
    assert json.loads(shown.out)
    assert main(['show', str(odd)]) == 0 and capsys.readouterr().err == ''


def test_robot_has_them_all_in_its_results(odd, capsys):
    assert main(['robot', str(odd)]) == 0
    shown = capsys.readouterr()
    assert shown.err == '' and shown.out.count('note: ') == 8 and 'robot.tool' in shown.out


def test_what_changes_nothing_is_no_warning(odd, capsys):
    odd.write_text(_strong(urdf()))
    assert main(['show', str(odd)]) == 0
    assert capsys.readouterr().err == ''


def test_python_warns_of_one_kind(odd):
    with pytest.warns(DescriptionWarning, match=LEFT_OUT) as told:
        parallel_robot.show(str(odd))
    assert len(told) == 1 and str(told[0].message).endswith(MORE)


def test_a_node_logs_it(odd, domain, handlers, monkeypatch):
    log = []

    class Log:
        def warning(self, text):
            log.append(text)

        def __getattr__(self, name):
            return lambda *_, **__: None

    class Node(SuiteNode):
        def __init__(self):
            super().__init__('node', resolve)
            registry.robot_of(self.values)
            self.finish()

        def get_logger(self):
            return Log()

    monkeypatch.setattr(sys, 'argv', ['node', '--ros-args', '-p', f'scenario:={odd}'])
    assert run_node(Node) == 0
    assert log.count(LEFT_OUT) == log.count(MORE) == 1
