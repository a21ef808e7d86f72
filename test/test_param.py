"""Parameters and services of a running node from the command line, without the ros2 tools."""

import pytest
import yaml

from parallel_robot.cli import ros_session
from parallel_robot.cli.command_line import main

pytest_plugins = ['ros_fixtures']


@pytest.fixture
def controller(launch, domain, peer, monkeypatch):
    """A controller that answers; the command line is in its domain."""
    process = launch('parallel_robot_control.controller_node')
    peer.meet('controller', process)
    return process


def test_parameters_are_read_changed_together_and_dumped(controller, capsys):
    assert main(['param', 'get', 'controller', 'law', 'smc.z']) == 0
    assert capsys.readouterr().out == 'law: s_fotsmc\nsmc.z: 20.0\n'
    assert main(['param', 'set', '/controller', 'law=pid', 'smc.z=30']) == 0
    assert main(['param', 'set', 'controller', 'smc.z=40', 'law=nothing']) == 2
    assert "/controller refuses: unknown law 'nothing'" in capsys.readouterr().err
    assert main(['param', 'dump', 'controller']) == 0
    dumped = yaml.safe_load(capsys.readouterr().out)['/controller']['ros__parameters']
    assert (dumped['law'], dumped['smc.z'], dumped['joints'][0]) == ('pid', 30.0, 'joint1')


@pytest.mark.parametrize(
    ('words', 'code', 'reason'),
    [
        (['param', 'set', 'controller', 'nothing=3'], 2, "refuses: unknown parameter 'nothing'"),
        (['param', 'set', 'controller', 'law={a: 1}'], 2, "law cannot be {'a': 1}: a parameter"),
        (['param', 'set', 'controller', 'law=[1, a]'], 2, "law cannot be [1, 'a']: a parameter"),
        (['param', 'set', 'controller', f'law={10**25}'], 2, f'law cannot be {10**25}: a'),
        (['param', 'set', 'controller', 'law=null'], 2, "'law' has a value of unknown type"),
        (['param', 'get', 'controller', 'law', 'nothing'], 2, 'has no parameter nothing'),
        (['call', 'controller/nothing'], 2, 'without arguments: clear_fault, confirm_pose, em'),
        (['call', 'controller/get_parameters'], 2, 'is of rcl_interfaces/srv/GetParameters'),
        (['call', 'elsewhere/ready'], 1, 'no node /elsewhere is heard; those that are: /contr'),
    ],
)
def test_what_a_node_has_not_costs_one_line(controller, words, code, reason, capsys, monkeypatch):
    monkeypatch.setattr(ros_session, 'HEARD', 1.0)
    assert main(words) == code
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and reason in error


def test_services_are_called_and_refusals_told(controller, capsys):
    assert main(['call', 'controller/confirm_pose']) == 1
    assert capsys.readouterr().out == 'refused: the pose is known\n'
    assert main(['call', 'controller/emergency_stop']) == 0
    assert main(['call', 'controller/ready']) in (0, 1)


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        (['param', 'get', 'controller'], 'get NODE takes KEY'),
        (['param', 'dump', 'controller', 'law'], "dump NODE takes no more words, not 'law'"),
        (['param', 'set', 'controller', 'law'], "set takes KEY=VALUE, not 'law'"),
        (['call', 'ready'], 'call takes NODE/SERVICE, such as ready/ready'),
    ],
)
def test_words_that_are_missing_cost_one_line(words, reason, capsys):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and reason in error
