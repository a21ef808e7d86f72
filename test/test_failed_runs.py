"""Runs that fail: told with law, time and cause, kept as bags, without figures."""

import json
import re

import pytest

from parallel_robot import simulate
from parallel_robot.bags import history
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import DRIVEN_OUT, RunError

PUSHED = ['--duration', '1.5', '--set', 'disturbance.constant=[80,-80,50]']  # off its workspace


def test_a_run_that_diverges_is_kept_up_to_there(tmp_path, capsys):
    bag = tmp_path / 'bag'
    assert main(['simulate', 'paper_circle', *PUSHED, '--out', str(bag)]) == 1
    out, err = capsys.readouterr()
    last = err.splitlines()[-1]
    told = re.search(rf's_fotsmc: {DRIVEN_OUT} after t = (.*) s, fault before: the robot', last)
    log, past, _ = recording.read(bag)
    assert f'{log.time[-1]:.3f}' == told[1] and 0.1 < log.time[-1] < 1.5
    assert 'no figures' in out and 'µm' not in out and f'bag     {bag}' in out
    assert history.failure(past, log.start_stamp, int(log.stamps[-1]))
    assert main(['analyze', str(bag)]) == 0
    out = capsys.readouterr().out
    assert 'no figures of a run that was in a fault' in out and 'µm' not in out
    assert main(['analyze', str(bag), '--to', '0.01', '--figure', str(tmp_path / 'a.png')]) == 0
    assert 'µm' in capsys.readouterr().out
    assert main(['rerun', str(bag)]) == 0
    assert re.search(r'identical: \d+ messages$', capsys.readouterr().out)
    with pytest.raises(RunError, match=f's_fotsmc: {DRIVEN_OUT}'):
        simulate('paper_circle', duration=1.5, **{'disturbance.constant': [80.0, -80.0, 50.0]})


def test_compare_has_a_row_for_a_law_that_failed(tmp_path, capsys):
    found = tmp_path / 'found.json'
    laws = ['s_fotsmc', 'pid']
    words = ['compare', 'paper_circle', '--laws', *laws, '--json', str(found)]
    assert main([*words, *PUSHED]) == 1
    out, err = capsys.readouterr()
    for law in laws:
        assert re.search(rf'^ *{law} +no figures: {DRIVEN_OUT} after t = ', out, re.MULTILINE)
    assert err.endswith('every law failed\n')
    data = json.loads(found.read_text())
    assert not data['laws'] and not data['claims'] and set(data['faults']) == set(laws)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ([], ''),
        ([(1.0, 'stuck')], 'in a fault for 90 % of the run, first at t = 1.000 s: stuck'),
        ([(9.9, 'stuck')], 'in a fault for 1 % of the run, first at t = 9.900 s: stuck'),
        ([(1.0, 'stuck'), (2.0, '')], ''),
        (
            [(1.0, 'stuck'), (2.0, 'late'), (4.0, ''), (5.0, 'hot'), (8.5, '')],
            'in a fault for 65 % of the run, first at t = 1.000 s: stuck',
        ),
    ],
)
def test_most_of_a_run_or_its_end_in_a_fault_is_a_failure(changes, reason):
    assert faults.failure(changes, 10.0) == reason
    assert 'all of the run' in faults.failure([(0.0, 'stuck')], 0.0)
