"""Robots from files with a fault: each costs one line, or is named by `verify`."""

from pathlib import Path

import pytest

from parallel_robot.cli.command_line import main

pytest_plugins = ['warm_trials']
pytestmark = pytest.mark.usefixtures('warm_trials')

EXAMPLE = Path(__file__).parents[1] / 'docs' / 'example_robot.py'
POSE = ['--set', 'plant.initial_pose=[0.231, 0.2]', '--set', 'circle.center=[0.2, 0.2]']


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
            ('return Estimate(select(every(inside), FOUND, 1), pose, model)', 'return pose'),
            'must return Estimate',
        ),
        (
            ('@kernel\ndef measure', 'def measure'),
            'wrong: measure is not compiled: put @kernel before it',
        ),
        (
            ('    none = vector(())  # no', '    none = np.empty(0)  # no'),
            'wrong: joint_motion returns passive as an array, not as a vector (docs/robots.md',
        ),
        (
            ('return vector((tool +', 'return np.array((tool +'),
            'wrong: estimate returns M as an array, not as a vector (docs/robots.md',
        ),
        (
            ('pose = robot.radius * position', 'pose = np.array([0.02, 0.02]) * position'),
            'mul(array(float64, 1d, C), Vector(2, float64)) (wrong.py:',
        ),
        (
            ('select(every(inside), FOUND, 1), pose', 'FOUND, vector((1.0, 2.0, 3.0))'),
            'wrong: estimate returns pose of shape (3,), not of size 2 (docs/robots.md',
        ),
        (
            ('return net_torque(load, torque, velocity, time) /', 'return 0.0 * time  #'),
            'wrong: acceleration must return a vector',
        ),
        (
            (
                'def joints(robot)',
                'def constants(robot):\n    return 1 // 0\n\n\ndef joints(robot)',
            ),
            'wrong: ZeroDivisionError',
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


CONTRADICTIONS = {  # where, what stands there with this fault, and the function that is named
    'pose_off': (
        'none, none, robot.radius', 'none, none, (1.01 if FAULT else 1.0) * robot.radius',
        'measure: pose, from that given to start: differs by 0.0023 of 0.23',
    ),
    'sign': (
        'motion.rate / r', '(-1.0 if FAULT else 1.0) * motion.rate / r',
        'joint_motion: velocity, from differences of position: differs by 50 of 25',
    ),
    'branch': (
        'motion.pose / r', '3.0 - motion.pose / r if FAULT else motion.pose / r',
        'joint_motion: position, from that of measure: differs by 20 of 12',
    ),
    'nowhere': (
        'position, FOUND)', 'position, 1 if FAULT else FOUND)',
        'locate: pose, from that whose joints it is given: not found or not finite',
    ),
    'no_number': (
        'return net_torque(', 'return (np.sqrt(time - 1.0) if FAULT else 1.0) * net_torque(',
        'acceleration: result: not found or not finite',
    ),
}  # fmt: skip
MODEL = '    model = Model('
TRANSPOSED = 'vector((vector((1.0, 0.5)), vector((0.0, 1.0))))'
FAILURES = {  # where, what stands there with this fault, and the checks that fail
    'light': (MODEL, f'    M = 0.999 * M if FAULT else M\n{MODEL}', ['M thdd']),
    'negative': (MODEL, f'    M = -M if FAULT else M\n{MODEL}', ['positive definite', 'M thd']),
    'coriolis': (
        'np.zeros_like(M)', '(0.1 if FAULT else 0.0) * M', ['Mdot - 2 Q', 'M thdd'],
    ),
    'skew': (
        MODEL, f'    M = {TRANSPOSED} if FAULT else M\n{MODEL}', ['from its transpose', 'M thdd'],
    ),
    'unreached': (
        'select(every(inside), FOUND, 1)', '1 if FAULT else select(every(inside), FOUND, 1)',
        ['within reach and margins'],
    ),
}  # fmt: skip
FAULTY = CONTRADICTIONS | FAILURES


@pytest.fixture(scope='module')
def faulty(tmp_path_factory):
    """The words for a robot with a fault: one file has all of them, and is compiled once."""
    text = EXAMPLE.read_text()
    field = "    fault: Annotated[float, Field('', 'which')] = 1.0\n"
    text = text.replace(' = 2e-4\n', f' = 2e-4\n{field}')
    for number, (old, fault, _) in enumerate(FAULTY.values(), start=2):
        assert text.count(old) == 1
        text = text.replace(old, fault.replace('FAULT', f'robot.fault == {number}.0'))
    file = tmp_path_factory.mktemp('faulty') / 'faulty.py'
    file.write_text(text)

    def words(name):
        robot = f'custom_robots=[{file}]', 'robot_model=faulty'
        number = f'robot.fault={2 + [*FAULTY].index(name)}'
        return [word for each in (*robot, number) for word in ('--set', each)]

    return words


@pytest.mark.parametrize('name', CONTRADICTIONS)
def test_a_robot_that_contradicts_itself_is_refused(name, faulty, tmp_path, capsys):
    words = [*faulty(name), *POSE, '--out', str(tmp_path / 'bag')]
    assert main(['simulate', 'paper_circle', *words]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1 and f'faulty: {FAULTY[name][2]}' in err
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('name', [None, *FAILURES])
def test_verify_names_each_check_that_fails(name, faulty, capsys):
    good = ['--set', f'custom_robots=[{EXAMPLE}]', '--set', 'robot_model=example_robot']
    words = faulty(name) if name else good
    wrong = FAILURES[name][2] if name else []
    assert main(['verify', *words]) == (1 if wrong else 0)
    lines = capsys.readouterr().out.splitlines()[2:]
    failed = [line for line in lines if not line.endswith('  agrees')]
    assert len(lines) > 8 and len(failed) == len(wrong)
    for line, what in zip(failed, wrong, strict=True):
        assert what in line and line.endswith('  wrong')
