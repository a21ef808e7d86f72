"""Custom trajectories: one file, found everywhere; a wrong one costs one line."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from bags import content
from custom_law import LAW
from untried import detach, forget

from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from trajectory_gen.configuration import trajectory_of

pytest_plugins = ['ros_fixtures', 'warm_trials']
pytestmark = pytest.mark.usefixtures('warm_trials')

COMMAND_LINE = 'parallel_robot.cli.command_line'
EXAMPLE = Path(__file__).parents[1] / 'docs' / 'example_trajectory.py'
OWN = ['--set', f'custom_trajectories=[{EXAMPLE}]', '--set', 'trajectory.shape=example_trajectory']
RATE = 'a * w * cosine * s_dot'
DEFAULTS = ('(0.49, 0.37, 0.5 * np.pi)', '(0.03, 0.02, 0.1)', '(2.0, 3.0, 1.0)', '12.0')


def named(path, **changes):
    code = {'custom_trajectories': [str(path)], 'trajectory.shape': path.stem}
    return resolve('paper_circle', code | changes)


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write the example with some of its text replaced; the test runs beside it."""
    monkeypatch.chdir(tmp_path)

    def write(name, *replaced):
        text = EXAMPLE.read_text()
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / f'{name}.py'
        path.write_text(text)
        return path

    return write


def test_the_example_is_short_and_draws_what_it_says():
    assert len(EXAMPLE.read_text().splitlines()) <= 30
    trajectory = trajectory_of(named(EXAMPLE, **{'example_trajectory.turns': [1, 2, 0]}))
    dt, t = 1e-3, np.arange(0.0, 12.5, 1e-3)
    found = trajectory.sample(t)
    u = np.minimum(t / 12.0, 1.0)
    s = 6 * u**5 - 15 * u**4 + 10 * u**3
    drawn = 0.49 + 0.03 * np.sin(2 * np.pi * s), 0.37 + 0.02 * np.sin(4 * np.pi * s)
    np.testing.assert_allclose(found.pose[:, 0], drawn[0], atol=1e-15)
    np.testing.assert_allclose(found.pose[:, 1], drawn[1], atol=1e-15)
    np.testing.assert_array_equal(found.pose[:, 2], 0.5 * np.pi)
    for rows, derived in (('position', 'velocity'), ('velocity', 'acceleration')):
        differences = np.gradient(getattr(found, rows), dt, axis=0)[1:-1]
        np.testing.assert_allclose(getattr(found, derived)[1:-1], differences, atol=1e-5)


def test_its_speed_factor_is_that_of_any_shape():
    first = trajectory_of(named(EXAMPLE))
    second = trajectory_of(named(EXAMPLE, **{'trajectory.speed_factor': 2.0}))
    assert (first.span, second.span) == (12.0, 6.0)
    np.testing.assert_array_equal(second.sample(1.5).velocity, 2 * first.sample(3.0).velocity)


WRONG = {
    'no_file': ([], 'custom_trajectories: no_file.py does not exist'),
    'circle': ([], 'custom_trajectories: circle is a group of parameters; rename the file'),
    'smc': ([], 'custom_trajectories: smc is a group of parameters; rename the file'),
    'syntax': ([('def motion(', 'def motion((')], 'SyntaxError'),
    'no_motion': ([('def motion', 'def move')], 'no_motion.py has no motion'),
    'no_span': ([('def span', 'def spam')], 'no_span.py has no span'),
    'no_default': ([(f' = {value}', '') for value in DEFAULTS], 'no_default.center has no'),
    'plain': ([('@kernel\n', '')], 'plain: motion is not compiled: put @kernel before it'),
    'unknown': ([('parameters.size', 'parameters.sise')], "Unknown attribute 'sise'"),
    'tuple_alone': ([('return PoseMotion(', 'return (')], 'motion must return PoseMotion(pose, '),
    'whole': ([('* sine, a', '* sine, np.arange(3)'), (RATE[1:], '')], 'three float arrays'),
    'outside': (
        [('sine, cosine =', 'a[0] = w[7]\n    sine, cosine =')],
        'outside: motion: IndexError: index is out of bounds',
    ),
    'endless': (
        [('sine, cosine =', 'while t > 1.0:\n        t += 1.0\n    sine, cosine =')],
        'endless: motion does not return within 1 s of processor time',
    ),
    'leaves': ([('class Par', 'import os; os._exit(3)\n\n\nclass Par')], 'process with code 3'),
    'raises': ([('    return parameters.duration', '    return 1 // 0')], 'raises: ZeroDivision'),
    'forever': ([('    return parameters.duration', '    return np.inf')], 'span must be a time'),
    'four': ([('1.0)', '1.0, 1.0)'), ('* np.pi)', '* np.pi, 1.0)'), ('0.1)', '0.1, 0.1)')],
             'four has 4 coordinates; the pose of planar_3rrr has 3: x, y, phi'),
}  # fmt: skip


@pytest.mark.parametrize('name', WRONG)
def test_a_wrong_one_costs_one_line(name, write, capsys):
    replaced, reason = WRONG[name]
    if name != 'no_file':
        write(name, *replaced)
    words = ['--set', f'custom_trajectories=[{name}.py]', '--set', f'trajectory.shape={name}']
    assert main(['simulate', 'paper_circle', *words, '--duration', '1', '--out', 'bag']) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1 and len(err) < 400
    assert reason in err and not Path('bag').exists()


FAULTY = {  # what a motion computes after all else, and what is said of it
    'speed': ('rate = 1.01 * rate', 'faulty: rate['),
    'sign': ('acceleration = a * w * (cosine * s_ddot + w * sine * s_dot**2)',
             'faulty: acceleration['),
    'jump': ('pose = pose + (t > 5.0)', 'faulty: pose[0] jumps by 0.99'),
    'step': ('pose = pose + 2e-3 * (t > 5.003)', 'faulty: pose[0] jumps by 0.00'),
    'spike': ('pose = pose + 3e-3 * (abs(t - 5.0) < 2.2e-3)', 'faulty: pose[0] jumps by'),
    'goes on': ('pose[0], rate[0] = pose[0] + 0.1 * t, rate[0] + 0.1',
                'faulty: pose[0] at t = 12.'),
    'not finite': ('pose = pose / (t > 6.0)', 's is ['),
    'sizes': ('rate = rate[:2]', 'faulty: rate at t = 0.0169706 s must'),
    'far': ('pose = pose + 0.5', 'motion refused at t = '),
}  # fmt: skip


@pytest.fixture(scope='module')
def faulty(tmp_path_factory):
    """A file with all of these faults, each for a value of a parameter; compiled once."""
    text = EXAMPLE.read_text().replace(
        '\n\n\n@', "\n    fault: Annotated[int, Field('', 'which', 0)] = 0\n\n\n@"
    )
    head, values = text.split('    return PoseMotion(')
    computed, after = values.split(')\n\n\n')
    lines = [f'{head}    pose, rate, acceleration = {computed}']
    for number, (line, _) in enumerate(FAULTY.values(), start=1):
        lines += [f'    if parameters.fault == {number}:', f'        {line}']
    lines += ['    return PoseMotion(pose, rate, acceleration)', '', '', after]
    path = tmp_path_factory.mktemp('faulty') / 'faulty.py'
    path.write_text('\n'.join(lines))
    return path


@pytest.mark.parametrize('name', FAULTY)
def test_wrong_values_cost_one_line(name, faulty, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ['--set', f'custom_trajectories=[{faulty}]', '--set', 'trajectory.shape=faulty']
    words += ['--set', f'faulty.fault={1 + [*FAULTY].index(name)}', '--duration', '1']
    assert main(['simulate', 'paper_circle', *words, '--out', 'bag']) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1 and len(err) < 400
    assert FAULTY[name][1] in err and not Path('bag').exists()


def test_names_are_told_apart(write, capsys):
    path = write('mine')
    (path.parent / 'b').mkdir()
    shutil.copy(path, path.parent / 'b')
    with pytest.raises(InputError, match='custom_trajectories: mine is a group of para'):
        resolve('paper_circle', {'custom_trajectories': ['mine.py', 'b/mine.py']})
    law = path.with_name('law') / 'mine.py'
    law.parent.mkdir()
    law.write_text(LAW)
    with pytest.raises(InputError, match='custom_trajectories: mine is a group of para'):
        resolve('paper_circle', {'custom_trajectories': ['mine.py'], 'custom_laws': [str(law)]})
    with pytest.raises(InputError, match=r"unknown trajectory.shape 'mien'; did you mean 'mine'?"):
        trajectory_of(named(path) | {'trajectory.shape': 'mien'})
    with pytest.raises(InputError, match=r'known: circle, ellipse, .*waypoints'):
        trajectory_of(resolve('paper_circle', {'trajectory.shape': 'spiral'}))
    with pytest.raises(InputError, match=r"'mine.durations'; did you mean 'mine.duration'?"):
        named(path, **{'mine.durations': 3})


def test_lockstep_gives_the_bytes_of_the_simulation(launch, domain, tmp_path):
    words = ['paper_circle', '--duration', '0.3', *OWN, '--set', 'example_trajectory.duration=2']
    process = launch(COMMAND_LINE, 'run', *words, '--time-mode', 'lockstep', '--out', 'nodes')
    assert process.wait() == 0, process.stderr
    assert main(['simulate', *words, '--out', str(tmp_path / 'simulated')]) == 0
    bags = [tmp_path / name for name in ('nodes', 'simulated')]
    nodes, simulated = (content(next(bag.glob('*.mcap'))) for bag in bags)
    assert nodes == simulated and len(nodes['reference']) == 301
    for bag in bags:
        stored = recording.read(bag).history.sources['custom_trajectories']
        assert stored == {'example_trajectory': EXAMPLE.read_bytes()}
        assert recording.read(bag).log.config['example_trajectory.duration'] == 2.0
    assert main(['replay', str(bags[0]), '--trust']) == 0


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """A directory with a bag of a custom trajectory, whose file is gone."""
    directory = tmp_path_factory.mktemp('recorded')
    file = directory / 'mine.py'
    file.write_text(EXAMPLE.read_text())
    words = ['--set', f'custom_trajectories=[{file}]', '--set', 'trajectory.shape=mine']
    words += ['--duration', '0.1', '--out', str(directory / 'bag')]
    assert main(['simulate', 'paper_circle', *words]) == 0
    file.unlink()
    return directory


@pytest.fixture
def gone(recorded, tmp_path, monkeypatch, capsys):
    """A copy of the bag, beside which the test runs, and the place where the file was."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    monkeypatch.chdir(tmp_path)
    shutil.copytree(recorded / 'bag', tmp_path / 'bag')
    yield tmp_path / 'bag', recorded / 'mine.py'
    (recorded / 'mine.py').unlink(missing_ok=True)


def test_it_comes_from_the_bag(gone, capsys):
    bag, _ = gone
    assert main(['rerun', str(bag), '--trust', '--out', 'again']) == 0
    assert main(['replay', str(bag), '--trust']) == 0
    out, err = capsys.readouterr()
    assert 'identical: 382 messages' in out and 'identical: 101 commands' in out
    assert 'runs the code of mine, which the bag holds' in err


@pytest.mark.usefixtures('page_alone')
@pytest.mark.parametrize('attached', [True, False])
@pytest.mark.parametrize('command', ['analyze', 'replay', 'rerun', 'report', 'export'])
def test_a_file_that_a_bag_holds_or_names_is_not_run(command, attached, gone, monkeypatch, capsys):
    bag, file = gone
    file.write_text('import pathlib\npathlib.Path("ran").touch()\n' + EXAMPLE.read_text())
    if not attached:
        detach(bag, 'custom_trajectories', 'mine')
    forget(monkeypatch)
    out = {'report': 'report.html', 'export': 'table.csv'}.get(command)
    code = main([command, str(bag), *(['--out', out] if out else [])])
    err = capsys.readouterr().err
    assert not Path('ran').exists() and 'runs the code' not in err
    runs = command in ('replay', 'rerun')
    assert code == (2 if runs else 0)
    if runs:
        reason = (
            'holds the code of the trajectory mine' if attached else 'hold the trajectory mine'
        )
        assert reason in err and err.count('\n') == 1


def test_one_that_did_not_run_needs_no_consent(tmp_path, capsys):
    bag = str(tmp_path / 'bag')
    words = ['--duration', '0.1', *OWN[:2], '--out', bag]
    assert main(['simulate', 'paper_circle', *words]) == 0
    assert main(['replay', bag]) == 0
    assert 'runs the code' not in capsys.readouterr().err


def test_it_is_swept_and_shown(tmp_path, capsys):
    study = tmp_path / 'speed.yaml'
    study.write_text(
        'scenarios: [paper_circle]\nlaws: [pid]\nruns: 2\nseed: 1\nduration: 0.2\n'
        'uncertainty:\n'
        '  example_trajectory.duration: {distribution: uniform, low: 6.0, high: 12.0}\n'
    )
    code = main(['sweep', str(study), *OWN, '--workers', '1', '--out', str(tmp_path / 'rows')])
    assert code == 0, capsys.readouterr().err
    plot = tmp_path / 'plan.png'
    assert main(['show', 'paper_circle', *OWN, '--plot', str(plot)]) == 0
    out = capsys.readouterr().out
    line = next(line for line in out.splitlines() if line.startswith('example_trajectory.dur'))
    assert line.split()[1:3] == ['12', 's'] and plot.stat().st_size > 10_000
