"""A robot from a file of the user's: it runs everywhere, and a wrong one costs one line."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from bags import table_of
from test_rerun import by_hand
from untried import detach, forget
from vectors import OnVectors

from parallel_robot import calibrate, save, simulate
from parallel_robot.analysis.readable_metrics import as_data
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.bags.run import recording
from parallel_robot.bags.run.recorded_robot import RobotCode
from parallel_robot.cli.command_line import main
from parallel_robot.python.notebook import load, metrics
from parallel_robot_control.configuration import resolve
from parallel_robot_model.robots.contract import FOUND
from parallel_robot_model.robots.registry import robot_of

pytest_plugins = ['warm_trials']
pytestmark = pytest.mark.usefixtures('warm_trials')

EXAMPLE = Path(__file__).parents[1] / 'docs' / 'example_robot.py'
CHANGES = {'custom_robots': [str(EXAMPLE)], 'robot_model': 'example_robot', 'duration': 3.0}
WORDS = [
    'paper_circle', '--duration', '3', '--set', f'custom_robots=[{EXAMPLE}]',
    '--set', 'robot_model=example_robot',
]  # fmt: skip

MOVED = {'plant.initial_pose': [0.231, 0.2], 'circle.center': [0.2, 0.2]}
POSE = [word for key, value in MOVED.items() for word in ('--set', f'{key}={value}')]


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
    log = recording.read(bag).log
    radius = 0.02
    error = radius * (log.reference_position - log.position)
    assert log.joints == ('motor_x', 'motor_y') and len(log.time) == 3001
    assert np.abs(error[0]).max() == pytest.approx(1e-3)  # it starts beside the circle
    assert np.abs(error[2000:]).max() < 5e-5
    assert np.hypot(*(radius * log.reference_position - 0.2).T) == pytest.approx(0.03)


CODES = [['--trust'], ['--set', f'custom_robots=[{EXAMPLE}]']]


@pytest.mark.parametrize('words', CODES)
def test_its_bag_has_the_figures_of_its_simulation(words, bag, tmp_path):
    run = simulate('paper_circle', law='s_fotsmc', **CHANGES, **MOVED)
    expected = metrics(run)
    assert expected['xy_rms_m'] > 0.0
    assert main(['analyze', str(bag), *words, '--json', str(tmp_path / 'found.json')]) == 0
    found = json.loads((tmp_path / 'found.json').read_text())
    assert found['steady'] == pytest.approx(as_data(expected)['steady'], rel=1e-12)
    code = RobotCode(True) if words == CODES[0] else RobotCode(files=(str(EXAMPLE),))
    again = load(bag, trust=code.trust, custom_robots=list(code.files))
    assert metrics(again) == expected and np.array_equal(again.pose, run.pose)
    assert 'platform_error_m' in again.to_frame() and 'not known' not in repr(again)
    ((report,),) = read_runs([bag], code=code).values()
    assert vars(report.metrics) == vars(expected) and report.motion.poses.place == 2
    columns, warnings = table_of(bag, code=code)
    assert np.array_equal(columns['platform_x_m'], run.pose[:, 0]) and not warnings
    words = [str(bag), '--rate', '1', '--out', str(tmp_path / 'robot.gif'), *words]
    assert main(['video', *words]) == 0


@pytest.mark.usefixtures('page_alone')
def test_without_its_file_a_bag_has_no_pose(bag, tmp_path, capsys):
    assert main(['analyze', str(bag), '--figure', str(tmp_path / 'run.png')]) == 0
    out, err = capsys.readouterr()
    assert 'seen joint error' in out and 'end-effector' not in out and err == ''
    assert main(['report', str(bag), '--out', str(tmp_path / 'report')]) == 0
    for text in (out, (tmp_path / 'report' / 'report.html').read_text()):
        assert 'example_robot is not known' in text and '--trust runs its file' in text
    run = load(bag)
    assert np.isnan(run.pose).all() and not run.place and '--trust' in repr(run)
    assert run.error.any() and not any('pose' in column for column in run.to_frame())
    columns, (warning,) = table_of(bag)
    assert not any('pose' in column or 'platform' in column for column in columns)
    assert 'example_robot is not known' in warning
    capsys.readouterr()
    for words in (
        ['video', str(bag), '--out', str(tmp_path / 'robot.gif')],
        ['export', str(bag), '--foxglove', str(tmp_path / 'viewed')],
    ):
        assert main(words) == 2
        err = capsys.readouterr().err
        assert err.count('\n') == 1 and '--set custom_robots=[FILE]' in err


def test_a_robot_whose_digest_is_noted_is_known(bag, tmp_path, monkeypatch):
    noted = tmp_path / 'parallel_robot' / 'trusted_laws'
    noted.parent.mkdir()
    noted.write_text(hashlib.sha256(EXAMPLE.read_bytes()).hexdigest())
    assert not load(bag).place
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    assert load(bag).place == 2


def test_a_file_that_is_not_its_own_is_refused(bag, tmp_path, capsys):
    other = Path(shutil.copy(EXAMPLE, tmp_path / 'other.py'))
    assert main(['analyze', str(bag), '--set', f'custom_robots=[{other}]']) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and 'custom_robots has no file example_robot.py' in err


def test_the_model_of_the_controller_is_that_of_the_plant():
    robot = robot_of(resolve('paper_circle', CHANGES))
    margins = robot.module.SafetyMargins(0.02)
    found = OnVectors(robot.module).estimate(
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


@pytest.mark.parametrize('name', ['planar_3rrr', 'serial_2r', 'axes'])
def test_robots_of_the_suite_pass(name, capsys):
    assert main(['verify', '--set', f'robot_model={name}']) == 0
    assert capsys.readouterr().out.count('  agrees') == 13


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """A directory with a bag of a custom robot, whose file is gone.

    It is a copy of the example, so that both are compiled once.
    """
    directory = tmp_path_factory.mktemp('recorded')
    robot = Path(shutil.copy(EXAMPLE, directory))
    words = ['--set', f'custom_robots=[{robot}]', '--set', 'robot_model=example_robot']
    words += ['--set', 'robot.tool=3', '--duration', '0.1', *POSE]
    assert main(['simulate', 'paper_circle', *words, '--out', str(directory / 'bag')]) == 0
    robot.unlink()
    return directory


@pytest.fixture
def gone(recorded, tmp_path, monkeypatch, capsys):
    """A copy of the bag, beside which the test runs, and the place where the file was."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    monkeypatch.chdir(tmp_path)
    shutil.copytree(recorded / 'bag', tmp_path / 'bag')
    robot = recorded / 'example_robot.py'
    yield tmp_path / 'bag', robot
    robot.unlink(missing_ok=True)


def test_it_comes_from_the_bag(gone, capsys):
    bag, _ = gone
    assert recording.read(bag).history.sources['custom_robots'] == {
        'example_robot': EXAMPLE.read_bytes()
    }
    again = bag.with_name('again')
    assert main(['rerun', str(bag), '--trust', '--out', str(again)]) == 0
    assert main(['replay', str(bag), '--trust']) == 0
    out, err = capsys.readouterr()
    assert 'identical: 382 messages' in out and 'identical: 101 commands' in out
    assert 'runs the code of example_robot, which the bag holds' in err
    assert recording.read(again).history.sources == recording.read(bag).history.sources
    assert recording.read(again).log.config['robot.tool'] == 3.0


def test_it_comes_from_the_bag_as_its_scenario_does(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    scenario, bag = tmp_path / 'mine.yaml', tmp_path / 'bag'
    scenario.write_text(
        'base: paper_circle\nrobot_model: example_robot\nduration: 0.1\nrobot.tool: 3.0\n'
        'plant.initial_pose: [0.231, 0.2]\ncircle.center: [0.2, 0.2]\n'
    )
    words = ['--set', f'custom_robots=[{EXAMPLE}]', '--out', str(bag)]
    assert main(['simulate', str(scenario), *words]) == 0
    scenario.unlink()
    assert main(['rerun', str(bag), '--trust']) == 0
    assert 'identical: 382 messages' in capsys.readouterr().out
    log = recording.read(tmp_path / 'bag_rerun').log
    assert (log.scenario, log.config['robot_model']) == ('mine', 'example_robot')
    assert (log.config['robot.tool'], log.config['true_robot.tool']) == (3.0, 3.0)


@pytest.mark.parametrize('command', ['rerun', 'replay'])
def test_the_code_of_the_bag_is_refused_in_one_line(command, gone, capsys):
    bag, _ = gone
    assert main([command, str(bag)]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1
    assert (
        f'{bag} holds the code of the robot example_robot, which would run' in err
        and '--trust' in err
    )


def test_another_file_takes_the_place_of_that_in_the_bag(gone, capsys):
    bag, robot = gone
    wrong = bag.with_name('wrong') / robot.name
    wrong.parent.mkdir()
    wrong.write_text(EXAMPLE.read_text().replace('return 2', 'return 1 // 0'))
    assert main(['replay', str(bag), '--set', f'custom_robots=[{wrong}]']) == 2
    err = capsys.readouterr().err
    assert 'example_robot: ZeroDivisionError' in err and 'runs the code' not in err
    robot.write_text(EXAMPLE.read_text())
    assert main(['replay', str(bag), '--set', f'custom_robots=[{robot}]']) == 0
    assert 'difference of torques' in capsys.readouterr().out


def test_a_robot_that_did_not_run_needs_no_consent(tmp_path, capsys):
    words = ['--duration', '0.1', '--set', f'custom_robots=[{EXAMPLE}]']
    assert main(['simulate', 'paper_circle', *words, '--out', str(tmp_path / 'bag')]) == 0
    assert main(['rerun', str(tmp_path / 'bag')]) == 0
    out, err = capsys.readouterr()
    assert 'identical: 382 messages' in out and 'runs the code' not in err


def test_a_bag_recorded_by_hand_holds_the_robot_of_its_controller(gone, tmp_path, capsys):
    bag, robot = gone
    robot.write_text(EXAMPLE.read_text())
    log = recording.read(bag).log
    parameters = log.config | {'custom_robots': [str(robot)]}
    nodes = dict.fromkeys(('trajectory', 'plant', 'controller'), parameters)
    assert by_hand(tmp_path / 'hand', bag, **nodes) == []
    robot.write_text('raise SystemExit("the file that the bag names is not run")')
    again = recording.read(tmp_path / 'hand').log
    assert again.config['robot.tool'] == 3.0 and again.joints == ('motor_x', 'motor_y')
    assert main(['replay', str(tmp_path / 'hand'), '--trust']) == 0
    assert 'identical: 101 commands' in capsys.readouterr().out


@pytest.mark.usefixtures('page_alone')
@pytest.mark.parametrize('attached', [True, False])
@pytest.mark.parametrize('command', ['analyze', 'replay', 'rerun', 'report', 'export'])
def test_a_file_that_a_bag_only_names_is_not_loaded(
    command, attached, gone, tmp_path, monkeypatch, capsys
):
    bag, robot = gone
    robot.write_text('open("ran", "w")\n' + EXAMPLE.read_text())
    if not attached:
        detach(bag, 'custom_robots', 'example_robot')
    forget(monkeypatch)
    out = {'report': 'report.html', 'export': 'table.csv'}.get(command)
    code = main([command, str(bag), *(['--out', out] if out else [])])
    err = capsys.readouterr().err
    assert not Path('ran').exists() and 'runs the code' not in err
    runs = command in ('replay', 'rerun')
    assert code == (2 if runs else 0)
    if runs:
        robot = 'the robot example_robot'
        assert (f'holds the code of {robot}' if attached else f'does not hold {robot}') in err


def test_a_file_that_a_controller_named_is_not_loaded(gone, tmp_path, monkeypatch, capsys):
    bag, robot = gone
    controller = recording.read(bag).log.config | {'custom_robots': [str(robot)]}
    lines = by_hand(tmp_path / 'hand', bag, plant=controller, controller=controller)
    assert lines == [f'the robot file {robot} is not on this machine']
    robot.write_text('open("ran", "w")\n' + EXAMPLE.read_text())
    forget(monkeypatch)
    capsys.readouterr()
    for command in ('replay', 'rerun'):
        assert main([command, str(tmp_path / 'hand'), '--trust']) == 2
        assert 'does not hold the robot example_robot' in capsys.readouterr().err
    assert not Path('ran').exists()


def test_a_custom_robot_is_calibrated_by_its_file(tmp_path, capsys):
    """The table of the documentation, whose pulleys are larger than it believes."""
    mine = CHANGES | {'plant.initial_pose': [0.241, 0.2], 'circle.center': [0.2, 0.2]}
    true = {'true_robot.radius': 0.0201, 'sensor.zero_angle': [0.01, -0.02]}
    made = simulate('paper_circle', **mine | true | {'duration': 6})
    assert made.fault is None
    bag = tmp_path / 'bag'
    save(made, bag)
    rows = np.arange(1000, 6000, 40)
    pose = made.pose[rows] + 1e-5 * np.random.default_rng(0).normal(size=(len(rows), 2))
    poses = tmp_path / 'poses.csv'
    table = np.column_stack([made.time[rows], pose])
    np.savetxt(poses, table, '%.9f', ',', header='t,x,y', comments='')
    found = calibrate(bag, poses=poses, custom_robots=[EXAMPLE])
    assert found.values['robot.radius'] == pytest.approx(0.0201, abs=2.5e-6)
    np.testing.assert_allclose(found.values['estimator.zero_angle'], [0.01, -0.02], atol=1e-3)
    capsys.readouterr()
    assert main(['calibrate', str(bag), '--poses', str(poses)]) == 2
    assert 'example_robot is not known' in capsys.readouterr().err
