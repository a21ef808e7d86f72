"""A run is as long as its motion, where nothing says how long it is."""

import json

import pytest

from parallel_robot import simulate
from parallel_robot.analysis.readable_metrics import as_data
from parallel_robot.cli.command_line import main
from parallel_robot.python.notebook import metrics
from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.plan import plan
from parallel_robot_model.common.errors import InputError
from trajectory_gen.configuration import resolve, trajectory_of, with_duration

LINE = {'trajectory.shape': 'line', 'line.duration': 0.4}
POINTS = {
    'trajectory.shape': 'waypoints',
    'waypoints.times': [3.0, 3.2, 3.5],
    'waypoints.points': [0.5, 0.4, 0.0, 0.51, 0.4, 0.0, 0.5, 0.4, 0.0],
}


@pytest.mark.parametrize(
    ('values', 'end'),
    [
        (LINE, 0.4),
        (LINE | {'trajectory.speed_factor': 0.5}, 0.8),
        (POINTS, 0.5),
        (POINTS | {'waypoints.periodic': True}, None),
        ({'trajectory.shape': 'trapezoid'}, pytest.approx(5.0, abs=5.0)),
        ({'trajectory.shape': 'excitation'}, 15.0),
        ({'trajectory.shape': 'hold'}, None),
        ({}, None),  # a circle
        (LINE | {'line.end': [0.5, 0.4], 'line.start': [0.5, 0.4]}, None),  # never moves
    ],
)
def test_a_motion_that_comes_to_rest_has_an_end(values, end):
    assert trajectory_of(resolve('paper_circle', values)).end == end


@pytest.mark.parametrize(
    ('scenario', 'values', 'hold', 'duration'),
    [
        ('paper_line', {}, None, 6.0),
        ('paper_line', {'trajectory.speed_factor': 0.7}, None, 8.572),  # whole periods
        ('paper_line', {'duration': 2.5}, None, 2.5),
        ('paper_line', {}, 1.5, 7.5),
        ('axes_step', {}, None, 2.0),
        ('paper_circle', {}, None, 12.0),
        ('eight_waypoints', {}, None, None),  # the scenario says it
    ],
)
def test_a_run_is_as_long_as_its_motion(scenario, values, hold, duration):
    assert with_duration(scenario, values, hold).get('duration') == duration


@pytest.mark.parametrize(
    ('scenario', 'values', 'hold', 'reason'),
    [
        ('paper_circle', {}, 1.0, 'this one has none'),
        ('paper_line', {'duration': 3.0}, 1.0, 'hold and duration exclude each other'),
        ('paper_line', {}, -1.0, 'hold must be at least 0'),
        ('paper_line', {}, float('nan'), 'hold must be finite'),
    ],
)
def test_a_hold_needs_an_end(scenario, values, hold, reason):
    with pytest.raises(InputError, match=reason):
        with_duration(scenario, values, hold)


def test_figures_of_a_motion_are_the_same_with_a_hold(tmp_path, capsys):
    """In Python, `compare` and `analyze`; what follows the motion is looked at when asked."""
    held, alone = (simulate('paper_circle', hold=hold, **LINE) for hold in (0.3, None))
    assert held.time[-1] == pytest.approx(0.7) and alone.time[-1] == pytest.approx(0.4)
    found, expected = metrics(held), metrics(alone)
    for group in ('steady', 'transient'):
        assert as_data(found)[group] == as_data(expected)[group]
    assert found.window[:3] == pytest.approx((0.2, 0.4, 0.7))
    assert metrics(held, start=0.4).window[:2] == pytest.approx((0.4, 0.7))
    words = [word for key, value in LINE.items() for word in ('--set', f'{key}={value}')]
    out, bag = tmp_path / 'found.json', tmp_path / 'bag'
    compare = ['compare', 'paper_circle', '--laws', 's_fotsmc', *words, '--hold', '0.3']
    assert main([*compare, '--json', str(out)]) == 0
    steady = json.loads(out.read_text())['laws']['s_fotsmc']['steady']
    assert steady == as_data(expected)['steady']
    assert main(['simulate', 'paper_circle', *words, '--hold', '0.3', '--out', str(bag)]) == 0
    told = capsys.readouterr().out
    assert told.count('over the second half of its motion, 0.2 to 0.4 s; else it is at rest') == 2
    figure = ['--figure', str(tmp_path / 'run.png')]
    analyze = ['analyze', str(bag), '--json', str(tmp_path / 'part.json'), *figure]
    assert main([*analyze, '--from', '0.4']) == 0
    part = json.loads((tmp_path / 'part.json').read_text())
    assert part['window'] == {'start_s': 0.4, 'stop_s': 0.7, 'run_s': 0.7}
    assert 'errors over 0.4 to 0.7 s, and all other figures, too' in capsys.readouterr().out
    assert main(['analyze', str(bag), '--from', '0.5', '--to', '0.4']) == 2
    assert '--from 0.5 must be before --to 0.4' in capsys.readouterr().err


def test_runs_of_a_study_are_as_long_as_their_motions():
    text = 'scenarios: [paper_line, axes_step, paper_circle]\nlaws: [smc]\nruns: 1\n'
    planned = plan(study.parse(text))
    assert [case.nominal['duration'] for case in planned.cases] == [6.0, 2.0, 12.0]
    assert planned.durations == [2.0, 6.0, 12.0]
    assert plan(study.parse(text + 'duration: 3.0\n')).durations == [3.0]
