"""A robot from a file of the user's: it runs everywhere, and a wrong one costs one line."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from parallel_robot_analysis.command_line import main
from parallel_robot_bags import run_log
from parallel_robot_control.configuration import resolve
from parallel_robot_model.contract import FOUND
from parallel_robot_model.robots import robot_of

EXAMPLE = Path(__file__).parents[1] / 'docs' / 'example_robot.py'
CHANGES = {'custom_robots': [str(EXAMPLE)], 'robot_model': 'example_robot', 'duration': 3.0}
WORDS = [
    'paper_circle', '--duration', '3', '--set', f'custom_robots=[{EXAMPLE}]',
    '--set', 'robot_model=example_robot',
]  # fmt: skip

POSE = ['--set', 'plant.initial_pose=[0.231, 0.2]', '--set', 'circle.center=[0.2, 0.2]']


def test_its_defaults_stand_beneath_the_scenario():
    values = resolve('paper_circle', CHANGES | {'robot.tool': 3.0})
    assert values['joints'] == ['motor_x', 'motor_y'] and values['robot.bridge'] == 6.0
    assert (values['robot.tool'], values['true_robot.tool']) == (3.0, 3.0)
    assert values['safety.torque_limit'] == 30.0  # one number is for all joints


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('table') / 'bag'
    assert main(['simulate', *WORDS, *POSE, '--out', str(directory)]) == 0
    return directory


def test_the_paper_s_law_tracks_a_circle_with_it(bag):
    log = run_log.read(bag)
    radius = 0.02
    error = radius * (log.reference_position - log.position)
    assert log.joints == ('motor_x', 'motor_y') and len(log.time) == 3001
    assert np.abs(error[0]).max() == pytest.approx(1e-3)  # it starts beside the circle
    assert np.abs(error[2000:]).max() < 5e-5
    assert np.hypot(*(radius * log.reference_position - 0.2).T) == pytest.approx(0.03)


def test_the_model_of_the_controller_is_that_of_the_plant():
    robot = robot_of(resolve('paper_circle', CHANGES))
    margins = robot.module.SafetyMargins(0.02)
    found = robot.module.estimate(
        robot.parameters, margins, np.array([10.0, 5.0]), np.zeros(2), np.zeros(2)
    )
    assert found.fault == FOUND and np.allclose(found.pose, [0.2, 0.1])
    assert np.allclose(np.diag(found.model.M), [2e-4 + 8.0 * 4e-4, 2e-4 + 2.0 * 4e-4])


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ([], 'plant.initial_pose must be [x, y], not [0.5284'),  # that of the paper's robot
        (['joints=[a, b, c]'], 'joints must be 2 names, one for each joint'),
        (['safety.damping=[1, 2, 3]'], 'safety.damping must be a number or a list of 2 numbers'),
        (['robot_model=example_robod'], "did you mean 'example_robot'"),
        (['robot.tool=0'], 'robot.tool must be positive, not 0'),
        (['controller.guess=[1, 2, 3]'], 'controller.guess must be empty or [x, y]'),
        (['circle.center=[0.5, 0.2]', 'plant.initial_pose=[0.2, 0.2]'], 'axis 1: '),
    ],
)
def test_what_does_not_suit_it_costs_one_line(words, reason, tmp_path, capsys):
    given = [word for pair in words for word in ('--set', pair)]
    code = main(['simulate', *WORDS, *given, '--out', str(tmp_path / 'bag')])
    out, err = capsys.readouterr()
    assert code == 2 and out == '' and err.count('\n') == 1 and reason in err
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (('class Parameters(NamedTuple)', 'class Parameters'), 'Parameters is not a NamedTuple'),
        (('DEFAULTS = {', 'DEFAULTS = 5\nOTHERS = {'), 'DEFAULTS must be a dictionary, not 5'),
        (('    return 2\n', '    return 1 // 0\n'), 'wrong: ZeroDivisionError'),
        (('return pose / robot.radius', 'return pose / robot.radios'), 'wrong: AttributeError'),
        (
            ('    pose = robot.radius', '    pose = robot.radios'),
            "wrong: estimate does not compile: Unknown attribute 'radios'",
        ),
        (
            ('return Estimate(fault, pose, model)', 'return pose'),
            'must return Estimate',
        ),
        (
            ('@kernel\ndef measure', 'def measure'),
            'wrong: measure is not compiled: put @kernel before it',
        ),
        (('def locate', 'def find'), 'has no locate'),
        (('import numpy as np', 'import numpy as np\nraise ValueError("no")'), 'ValueError: no'),
        (
            ('NamedTuple):\n    width', 'NamedTuple):\n    height: float\n    width'),
            'needs Annotated',
        ),
    ],
)
def test_a_wrong_file_costs_one_line(change, reason, tmp_path, capsys):
    file = tmp_path / 'wrong.py'
    file.write_text(EXAMPLE.read_text().replace(*change))
    words = ['--set', f'custom_robots=[{file}]', '--set', 'robot_model=wrong', *POSE]
    assert main(['simulate', 'paper_circle', *words, '--out', str(tmp_path / 'bag')]) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and reason in err


@pytest.mark.parametrize('command', ['analyze', 'replay'])
def test_a_file_that_a_bag_only_names_is_not_loaded(command, tmp_path):
    robot, mark = tmp_path / 'mine.py', tmp_path / 'ran'
    robot.write_text(EXAMPLE.read_text())
    named = ['--set', f'custom_robots=[{robot}]', '--set', 'robot_model=mine']
    words = ['paper_circle', '--duration', '0.1', *named, *POSE]
    assert main(['simulate', *words, '--out', str(tmp_path / 'bag')]) == 0
    robot.write_text(f'open({str(mark)!r}, "w")\n' + robot.read_text())
    module = 'parallel_robot_analysis.command_line'
    done = subprocess.run(
        [sys.executable, '-m', module, command, str(tmp_path / 'bag')],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[1],
    )
    assert not mark.exists()
    assert done.returncode == (0 if command == 'analyze' else 2) and 'Traceback' not in done.stderr
