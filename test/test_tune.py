"""`parallel_robot tune`: a small search, continued, and what it refuses."""

import csv

import pytest
import yaml

from parallel_robot_analysis.command_line import main
from parallel_robot_analysis.tuning.front import choose, front
from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_base.errors import InputError
from parallel_robot_control.configuration import resolve

pytest.importorskip('optuna')
OPTIONS = ['--duration', '0.05', '--workers', '1']


@pytest.fixture(scope='module')
def tuned(tmp_path_factory):
    out = tmp_path_factory.mktemp('tune') / 'pid'
    assert main(['tune', 'pid', 'paper_circle', '--out', str(out), '--trials', '3', *OPTIONS]) == 0
    return out


def test_its_gains_are_a_parameter_file_with_better_metrics_or_the_default(tuned):
    gains = yaml.safe_load((tuned / 'tuned.yaml').read_text())['pid']
    values = resolve('paper_circle', {f'pid.{name}': value for name, value in gains.items()})
    assert {f'pid.{name}' for name in gains} == {key for key in values if key.startswith('pid.')}
    assert all(value > 0.0 for value in gains.values())
    ros = yaml.safe_load((tuned / 'tuned_ros.yaml').read_text())
    assert 'ros__parameters' in str(ros)
    with (tuned / 'front.csv').open() as file:
        assert list(csv.reader(file))
    assert (tuned / 'front.svg').stat().st_size and (tuned / 'front.png').stat().st_size


def test_it_goes_on_and_refuses_what_is_not_the_same(tuned, capsys):
    out = str(tuned)
    assert main(['tune', 'pid', 'paper_circle', '--out', out, '--trials', '4', *OPTIONS]) == 0
    assert '4 trials' in capsys.readouterr().out
    assert main(['tune', 'smc', 'paper_circle', '--out', out, '--trials', '4', *OPTIONS]) == 2
    assert 'another law' in capsys.readouterr().err


@pytest.mark.parametrize(
    'words',
    [['pdi', 'paper_circle'], ['pid', 'paper_circel'], ['pid', 'paper_circle', '--trials', '0']],
)
def test_what_is_wrong_costs_one_line(words, tmp_path, capsys):
    assert main(['tune', *words, '--out', str(tmp_path / 'out')]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and not (tmp_path / 'out').exists()


def test_equal_effort_is_the_least_error_below_a_bound_of_the_chattering():
    figures = [(1.0, 9.0), (2.0, 3.0), (2.5, 4.0), (4.0, 1.0)]
    trials = [Trial(k, {}, {}, *pair) for k, pair in enumerate(figures)]
    points = front(trials)
    for bound, number in ((100.0, 0), (9.0, 0), (8.0, 1), (3.0, 1), (2.9, 3)):
        assert choose(points, trials[0], None, None, bound)[0].number == number
    with pytest.raises(InputError, match=r'0\.5 N m or less, the least is 1$'):
        choose(points, trials[0], None, None, 0.5)
