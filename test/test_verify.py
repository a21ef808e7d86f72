"""The command that holds the plants against MuJoCo: it agrees, and finds what is wrong."""

import sys

import numpy as np
import pytest

from parallel_robot.cli.command_line import main
from parallel_robot.studies import verification
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.mujoco_model import MujocoRobot

pytest.importorskip('mujoco')
SHORT = ['--robots', '2', '--duration', '0.1']


def test_all_robots_agree_with_mujoco(capsys):
    assert main(['verify', *SHORT]) == 0
    lines = capsys.readouterr().out.splitlines()[2:]
    assert [line.split()[0] for line in lines] == [*verification.SCENARIOS]
    assert all(line.endswith('  agrees') for line in lines)


def test_a_robot_depends_on_its_number_and_the_seed_alone():
    both = verification.verify_kind('axes', [0, 1], 3, 0.05)
    assert verification.verify_kind('axes', [1], 3, 0.05) == both[1:]
    assert verification.verify_kind('axes', [1], 4, 0.05) != both[1:]


@pytest.mark.parametrize(
    ('kind', 'name'), [('planar_3rrr', 'mp'), ('serial_2r', 'lc2'), ('axes', 'inertia')]
)
def test_a_parameter_that_is_a_thousandth_off_is_found(kind, name, monkeypatch, capsys):
    def built(robot, *others):
        wrong = 1.001 * np.asarray(getattr(robot.parameters, name))
        parameters = robot.parameters._replace(**{name: wrong})
        return MujocoRobot(robot._replace(parameters=parameters), *others)

    monkeypatch.setattr(verification, 'MujocoRobot', built)
    monkeypatch.setattr(verification, 'SCENARIOS', {kind: verification.SCENARIOS[kind]})
    assert main(['verify', *SHORT]) == 1
    assert 'more than 1e-09' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'wanted'),
    [
        (['--robots', '0'], '--robots must be at least 1, not 0'),
        (['--seed', '-1'], '--seed must not be negative, not -1'),
        (['--duration', 'nan'], '--duration must be 0.001 to 10 s, not nan'),
    ],
)
def test_wrong_numbers_cost_one_line(words, wanted, capsys):
    assert main(['verify', *words]) == 2
    assert capsys.readouterr().err == f'parallel_robot verify: {wanted}\n'


def test_what_cannot_be_built_is_refused(monkeypatch, capsys):
    with pytest.raises(InputError, match='can be built in MuJoCo, not mine'):
        MujocoRobot(RobotModel('mine', None, None), np.zeros(2), [])
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    assert main(['verify', *SHORT]) == 2
    assert 'mujoco is not installed; pip install mujoco' in capsys.readouterr().err
