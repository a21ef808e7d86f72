"""Changes of law and gains while a run was recorded: told, with figures for each stretch."""

import math

from parallel_robot import simulate
from parallel_robot.analysis.evaluated_bag import of_stretches
from parallel_robot.analysis.report import page
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.bags.history import Change, ControllerStatus, History
from parallel_robot.bags.run import run_windows
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands.analyze import of_stretch
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_sim.motions import of_simulation

START = 10 * NANOSECONDS


def status(time, law):
    return ControllerStatus(START + round(time * NANOSECONDS), law, 'none', '', ())


def past_of(statuses=(), changes=()):
    changed = tuple(
        Change(START + round(time * NANOSECONDS), node, values) for time, node, values in changes
    )
    return History({}, tuple(statuses), {}, changed, {}, {})


def found(past, law='pid'):
    return run_windows.stretches(past, law, START, START + 12 * NANOSECONDS)


def test_a_run_without_changes_is_one_stretch():
    assert found(past_of()) == [(0.0, 'pid', '')]
    again = past_of([status(0.0, 'pid'), status(3.0, 'pid')], [(1.0, '/recorder', {'pid.P': 1.0})])
    assert found(again) == [(0.0, 'pid', '')] and not run_windows.stretches_told(found(again))
    motion = past_of((), [(2.0, '/controller', {'trajectory.shape': 'hold'})])
    assert len(found(motion)) == 1


def test_laws_and_gains_that_change_are_told_with_their_times():
    statuses = [status(0.0, 'pid'), status(4.0, 'smc'), status(8.0, 'pid')]
    changes = [
        (6.0, '/cell/controller', {'smc.G': 9.0}),
        (8.0, '/controller', {'pid.P': 2.0, 'law': 'pid'}),
        (20.0, '/controller', {'pid.P': 3.0}),
    ]
    parts = found(past_of(statuses, changes), 'smc')
    assert [(one.begin, one.law) for one in parts] == [
        (0.0, 'pid'), (4.0, 'smc'), (6.0, 'smc'), (8.0, 'pid'),
    ]  # fmt: skip
    assert run_windows.laws_of(parts) == ('pid', 'smc')
    (line,) = run_windows.stretches_told(parts)
    assert 't = 4.000 s: law smc; t = 6.000 s: smc.G 9.0; t = 8.000 s: law pid, pid.P 2.0' in line


def test_each_stretch_has_its_own_figures():
    run = simulate('paper_circle', law='pid', duration=0.4)
    parts = [run_windows.Stretch(0.0, 'pid'), run_windows.Stretch(0.2, 'smc', 'law smc')]
    lines = [*map(of_stretch, of_stretches(of_simulation(run.simulation), parts))]
    assert lines[0].startswith('0 to 0.199 s, pid: end-effector error, rms')
    assert lines[1].startswith('0.2 to 0.4 s, smc: ')
    assert list(of_stretches(of_simulation(run.simulation), parts[:1])) == []


def test_motors_at_their_limit_are_told(tmp_path, capsys):
    words = ['simulate', 'paper_circle', '--duration', '0.2', '--out', str(tmp_path / 'bag')]
    assert main([*words, '--set', 'plant.torque_limit=[1, 0.5, 1]']) == 0
    line = 'the motors were at their limit (plant.torque_limit, 1, 0.5, 1 N m) in '
    assert line in capsys.readouterr().err
    assert main(['analyze', str(tmp_path / 'bag')]) == 0
    out = capsys.readouterr().out
    assert line in out and 'no limit acted' not in out
    run = simulate('paper_circle', duration=0.2, **{'plant.torque_limit': 0.5})
    assert '(plant.torque_limit, 0.5 N m)' in run.warnings[-1]
    assert 'limit' not in ' '.join(simulate('paper_circle', duration=0.2).warnings)


def test_a_report_tells_values_not_spellings_and_bold_is_better(tmp_path):
    for name, load in (('a', 0.0), ('b', [0.0, 0.0, 0.0])):
        words = ['--duration', '0.2', '--set', f'disturbance.constant={load}']
        assert main(['simulate', 'paper_circle', *words, '--out', str(tmp_path / name)]) == 0
    (runs,) = read_runs([tmp_path / 'a', tmp_path / 'b']).values()
    assert page.differences(runs) == {}
    assert page._best([1.0, 1.0]) == page._best([3.00001, 3.00002]) == page._best([2.0]) == ''
    assert page._best([1.0, math.inf, math.nan]) == '1.000'
    third = page._best([3.00001, 3.00002, 4.0])
    assert third == '3.000'
