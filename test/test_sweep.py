"""Sweeps: every row once, whatever is killed, and each row the one that runs alone."""

import io
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from bags import full_disk

from parallel_robot_analysis import metrics
from parallel_robot_analysis.command_line import main
from parallel_robot_analysis.study import results, study
from parallel_robot_analysis.study.plan import plan
from parallel_robot_analysis.study.run_chunk import Outcome
from parallel_robot_analysis.study.store import Store
from parallel_robot_analysis.study.sweep import sweep
from parallel_robot_analysis.study.table import schema, table
from parallel_robot_analysis.study.tasks import Task, run_task, tasks, version
from parallel_robot_analysis.study.workers import MOST_LOSSES, Processes, completed
from parallel_robot_bags import run_log
from parallel_robot_base.errors import InputError, RunError

ROOT = Path(__file__).parents[1]
TEXT = """
scenarios: [paper_circle]
laws: [smc, computed_torque]
runs: 40
seed: 3
duration: 0.2
uncertainty:
  true_robot.m1: {distribution: uniform, relative: 0.2}
  friction.viscous: {distribution: log_uniform, factor: [0.5, 2.0], common: true}
  plant.integrator: {distribution: choice, values: [ode3, rk4]}
"""
FAILING = """
scenarios: [paper_circle]
laws: [smc]
runs: 6
method: random
duration: 0.2
uncertainty:
  circle.radius: {distribution: choice, values: [0.03, 3.0]}
  true_robot.m1: {distribution: normal, mean: 1.0, std: 2.0}
"""


class Inline:
    """Workers that run a task in this process when they are waited for."""

    slots = 1

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, task):
        self.task = task

    def wait(self):
        return [(self.task, run_task(self.task))]


def planned(text=TEXT, runs=None):
    return plan(study.parse(text).changed(runs, {}))


def swept(out, text=TEXT, runs=None, workers=None, count=2):
    return sweep(planned(text, runs), text, out, workers or Inline(), count)


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """A sweep that ran through in one process."""
    out = tmp_path_factory.mktemp('sweep') / 'whole'
    swept(out)
    return out


def runs(out):
    return pq.read_table(out / 'runs.parquet')


def content(out):
    return (out / 'runs.parquet').read_bytes()


def test_there_is_one_row_a_run_with_units_in_the_columns(whole):
    found = runs(whole)
    assert found['row'].to_pylist() == list(range(80))
    assert set(found['status'].to_pylist()) == {'ok'} and not any(found['reason'].to_pylist())
    assert found['law'].to_pylist() == ['smc', 'computed_torque'] * 40
    assert {'xy_rms_m', 'torque_max_nm', 'chattering_nm', 'seed'} < set(found.column_names)
    for name in ('xy_rms_m', 'torque_max_nm', 'true_robot.m1', 'friction.viscous'):
        values = found[name].to_numpy()
        assert np.isfinite(values).all()
        assert len(np.unique(values.round(9))) >= (2 if name == 'torque_max_nm' else 40)
    assert set(found['plant.integrator'].to_pylist()) == {'"ode3"', '"rk4"'}
    assert np.isinf(found['to_0_1_mm_s'].to_numpy()).any()
    assert {path.name for path in whole.iterdir()} == {
        *('sweep.json', 'study.yaml', 'lock', 'runs.parquet'),
        *(f'summary.{suffix}' for suffix in ('txt', 'csv', 'tex', 'html')),
        *(f'distributions.{suffix}' for suffix in ('png', 'pdf')),
    }
    assert (whole / 'study.yaml').read_text() == TEXT


@pytest.mark.parametrize('row', [0, 57])
def test_a_row_that_runs_alone_has_the_metrics_of_the_sweep(row, whole, tmp_path, capsys):
    bag = tmp_path / 'bag'
    assert main(['simulate', str(whole), '--row', str(row), '--out', str(bag)]) == 0
    assert capsys.readouterr().err == ''
    log = run_log.read(bag)
    found = metrics.evaluate(log, metrics.poses(log))
    (expected,) = runs(whole).slice(row, 1).to_pylist()
    assert expected['law'] == log.law
    assert found.steady.xy_rms_m == expected['xy_rms_m']
    assert found.steady.sync_rms_rad == expected['sync_rms_rad']
    assert found.torque.max_nm == expected['torque_max_nm']
    assert found.torque.chattering_nm == expected['chattering_nm']
    assert (found.transient.to_1_mm_s or math.inf) == expected['to_1_mm_s']


def test_a_row_of_a_study_file_is_that_of_its_sweep(whole, tmp_path):
    (tmp_path / 'study.yaml').write_text(TEXT)
    bags = [tmp_path / 'a', tmp_path / 'b']
    for origin, bag in zip((whole, tmp_path / 'study.yaml'), bags, strict=True):
        assert main(['simulate', str(origin), '--row', '3', '--out', str(bag)]) == 0
    a, b = map(run_log.read, bags)
    np.testing.assert_array_equal(a.position, b.position)


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--row', '80'], '--row must be from 0 to 79, not 80'),
        (['--row', '-1'], '--row must be from 0'),
        (['--row', '1', '--law', 'smc'], '--law and --row exclude each other'),
        (['--row', '1', '--duration', '3'], '--duration and --row exclude each other'),
        (['--row', '1', '--set', 'smc.z=3'], 'a row of a sweep is run as it was'),
    ],
    ids=str,
)
def test_a_row_that_cannot_be_run(words, message, whole, tmp_path, capsys):
    assert main(['simulate', str(whole), *words, '--out', str(tmp_path / 'bag')]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1 and not list(tmp_path.iterdir())


def test_a_directory_that_is_no_sweep_has_no_rows(tmp_path, capsys):
    words = ['simulate', str(tmp_path), '--row', '1', '--out', str(tmp_path / 'bag')]
    assert main(words) == 2
    assert 'is not the directory of a sweep' in capsys.readouterr().err


def test_two_processes_make_the_same_file(whole, tmp_path):
    with_processes = tmp_path / 'processes'
    swept(with_processes, workers=Processes(2))
    assert content(with_processes) == content(whole)


def test_more_runs_of_a_sweep_only_add_rows(whole, tmp_path):
    swept(tmp_path, runs=13)
    assert runs(tmp_path).num_rows == 26
    swept(tmp_path)
    assert content(tmp_path) == content(whole)


def command(out, *words):
    """A sweep as a process."""
    module = 'parallel_robot_analysis'
    file = out.with_suffix('.yaml')
    file.write_text(TEXT)
    return [sys.executable, '-m', module, 'sweep', str(file), '--out', str(out), *words]


def children(pid):
    return Path(f'/proc/{pid}/task/{pid}/children').read_text().split()


def runs_on(pid):
    stat = Path(f'/proc/{pid}/stat')
    return stat.exists() and stat.read_text().rpartition(')')[2].split()[0] != 'Z'


def until(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def test_a_sweep_that_is_killed_three_times_ends_as_one_that_ran_through(whole, tmp_path):
    out = tmp_path / 'killed'
    parts = out / 'parts'
    for _ in range(3):
        before = set(parts.glob('*.parquet'))
        process = subprocess.Popen(command(out, '--workers', '2'), cwd=ROOT)
        while not set(parts.glob('*.parquet')) - before:
            assert process.poll() is None, 'it ended before it could be killed'
            time.sleep(0.01)
        workers = children(process.pid)
        process.kill()
        process.wait()
        assert len(workers) == 2 and until(lambda pids=workers: not any(map(runs_on, pids)))
        assert before < set(parts.glob('*.parquet')) and not (out / 'runs.parquet').exists()
    done = subprocess.run(command(out), cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stderr == '' and '40 runs of each law and scenario' in done.stdout
    assert content(out) == content(whole)


def test_ctrl_c_says_what_is_kept(tmp_path):
    out = tmp_path / 'interrupted'
    process = subprocess.Popen(command(out), cwd=ROOT, stderr=subprocess.PIPE, text=True)
    assert until(lambda: list((out / 'parts').glob('*.parquet')))
    process.send_signal(signal.SIGINT)
    error = process.communicate()[1]
    assert process.returncode == 130 and error.count('\n') == 1
    assert 'of 80 rows are kept, the same command continues' in error


def test_a_terminal_sees_how_long_it_takes(tmp_path, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr('sys.stderr', screen)
    swept(tmp_path, runs=4)
    assert '/8 [' in screen.getvalue() and 'run/s]' in screen.getvalue()


class Killing:
    """Worker processes of which each is killed once, with its task in hand."""

    def __init__(self, count):
        self.inner = Processes(count)
        self.victims = []

    def __enter__(self):
        self.inner.__enter__()
        return self

    def __exit__(self, *_):
        self.inner.__exit__()

    @property
    def slots(self):
        return self.inner.slots

    def submit(self, task):
        self.inner.submit(task)

    def wait(self):
        ended = self.inner.wait()
        if len(self.victims) < 2:
            pid = next(pid for pid in self.inner.pids if pid not in self.victims)
            self.victims.append(pid)
            os.kill(pid, signal.SIGKILL)
        return ended


def test_the_rows_of_killed_workers_are_run_again(whole, tmp_path):
    workers = Killing(2)
    swept(tmp_path / 'killed', workers=workers)
    assert len(workers.victims) == 2
    assert content(tmp_path / 'killed') == content(whole)


class Deadly:
    """A value that ends the process that takes it out of a pipe."""

    def __reduce__(self):
        return os._exit, (9,)


def test_a_row_that_kills_its_workers_is_a_failure_and_no_other_row_is():
    good = next(tasks(planned(), np.zeros(80, dtype=bool), 2))
    bad = Task(good.scenario, good.numbers[:3], (*good.overrides[:2], {'x': Deadly()}), version())
    with Processes(2) as workers:
        found = {
            task.numbers: outcomes for task, outcomes in completed(workers, iter([bad, good]))
        }
    assert set(found) == {good.numbers, *((number,) for number in bad.numbers)}
    statuses = [found[(number,)][0].status for number in bad.numbers]
    assert statuses == ['ok', 'ok', 'failed']
    assert found[(bad.numbers[2],)][0].reason.endswith(f'was lost, {MOST_LOSSES} times')
    assert found[good.numbers][2] != found[(bad.numbers[2],)][0]


def test_workers_that_cannot_start_end_the_sweep_with_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr('parallel_robot_analysis.study.workers.MODULE', 'parallel_robot_missing')
    with pytest.raises(RunError, match=r'cannot start: .*parallel_robot_missing'):
        swept(tmp_path / 'out', workers=Processes(2))


def test_a_worker_of_another_version_is_refused():
    one = next(tasks(planned(), np.zeros(80, dtype=bool), 2))
    with pytest.raises(RunError, match='a worker has another version of the suite'):
        run_task(Task(one.scenario, one.numbers, one.overrides, '0.0.0'))


def test_failures_are_rows_with_their_reason(tmp_path):
    summary = swept(tmp_path, FAILING)
    found = runs(tmp_path).to_pylist()
    assert [row['row'] for row in found] == list(range(6))
    assert {row['status'] for row in found} == {'ok', 'failed'}
    for row in found:
        if row['status'] == 'failed':
            expected = 'motion refused' if row['true_robot.m1'] > 0.0 else 'true_robot.m1 must be'
            assert expected in row['reason'] and row['xy_rms_m'] is None
        else:
            assert row['circle.radius'] == 0.03 and row['true_robot.m1'] > 0.0
            assert row['xy_rms_m'] > 0.0 and row['reason'] == ''
    assert 'motion refused at t = ' in summary


def test_a_fault_of_the_controller_is_a_row_with_its_metrics(tmp_path):
    swept(tmp_path, TEXT + 'set: {safety.speed_limit: 0.1}\n', runs=1)
    for row in runs(tmp_path).to_pylist():
        assert row['status'] == 'fault' and row['reason'].startswith('fault at t = 0.')
        assert row['xy_rms_m'] > 0.0


def refused(out, text=TEXT, **more):
    with pytest.raises(InputError) as raised:
        swept(out, text, **more)
    return str(raised.value)


def test_a_changed_study_a_version_and_fewer_runs_are_refused(whole, monkeypatch):
    before = {path: path.read_bytes() for path in whole.iterdir()}
    assert 'whose seed differs' in refused(whole, TEXT.replace('seed: 3', 'seed: 4'))
    assert 'whose uncertainty differs' in refused(whole, TEXT.replace('0.2}', '0.3}'))
    assert 'whose laws differs' in refused(whole, TEXT.replace('smc, c', 'pid, c'))
    changed = TEXT + 'set: {circle.radius: 0.02}\n'
    assert 'whose configuration differs' in refused(whole, changed)
    assert '--runs must be at least that, not 5' in refused(whole, runs=5)
    monkeypatch.setattr('parallel_robot_analysis.study.store.version', lambda: '9.9')
    assert 'made by another version of the suite' in refused(whole)
    assert {path: path.read_bytes() for path in whole.iterdir()} == before


def test_a_comment_may_change(whole, tmp_path):
    swept(tmp_path, runs=2)
    swept(tmp_path, '# the same\n' + TEXT, runs=2)


@pytest.mark.parametrize(
    'manifest', ['', '[]', '{}', '{"format": "parallel_robot sweep 1", "runs": "x"}', '\x00']
)
def test_a_directory_of_something_else_is_left_alone(manifest, tmp_path):
    (tmp_path / 'sweep.json').write_text(manifest)
    assert 'choose another --out' in refused(tmp_path)
    (tmp_path / 'sweep.json').unlink()
    (tmp_path / 'thesis.tex').write_text('mine')
    assert 'is not the directory of a sweep' in refused(tmp_path)
    assert (tmp_path / 'thesis.tex').read_text() == 'mine'


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / 'file').write_text('mine')
    assert 'cannot write to' in refused(tmp_path / 'file' / 'out')
    assert 'file' in refused(tmp_path / 'file')


def test_two_sweeps_do_not_share_a_directory(whole):
    with Store(whole, planned(), TEXT):
        assert 'another sweep is writing' in refused(whole)


def test_a_full_disk_costs_one_line_and_no_row(whole, tmp_path, capsys):
    file, out = tmp_path / 'study.yaml', tmp_path / 'out'
    file.write_text(TEXT)
    swept(out, runs=10)
    before = content(out)
    with full_disk(4096):
        assert main(['sweep', str(file), '--out', str(out), '--workers', '1']) == 1
    error = capsys.readouterr().err
    assert 'cannot write' in error and '20 of 80 rows are kept' in error
    assert error.count('\n') == 1 and content(out) == before
    assert not list(out.rglob('*.unfinished'))
    swept(out)
    assert content(out) == content(whole)


def test_a_part_that_is_cut_off_is_run_again(whole, tmp_path):
    found = planned()
    with Store(tmp_path, found, TEXT) as store:
        for task in list(tasks(found, store.done, 2))[:4]:
            rows = [found.row(number) for number in task.numbers]
            outcomes = run_task(task)
            store.add(table(schema(found), zip(rows, outcomes, strict=True)))
        done = int(store.done.sum())
        assert 0 < done < 80
    part = min((tmp_path / 'parts').iterdir())
    part.write_bytes(part.read_bytes()[:-20])
    (tmp_path / 'parts' / 'x.parquet.unfinished').write_bytes(b'')
    with Store(tmp_path, found, TEXT) as store:
        assert 0 < store.done.sum() < done
    swept(tmp_path)
    assert content(tmp_path) == content(whole)


def test_many_rows_are_merged_window_by_window(whole, tmp_path, monkeypatch):
    monkeypatch.setattr('parallel_robot_analysis.study.store.WINDOW', 7)
    swept(tmp_path)
    assert runs(tmp_path).equals(runs(whole))


def test_of_a_robot_without_a_plane_the_joints_are_compared(tmp_path):
    def outcome(k):
        steady = metrics.Errors(math.nan, math.nan, 1e-6 * (k + 1), 0.0)
        found = metrics.Metrics(
            0.2, metrics.Transient(math.nan, math.nan), steady, metrics.Torque(1.0, 2.0, 3.0)
        )
        return Outcome('ok', metrics=found)

    found = planned(runs=2)
    with Store(tmp_path, found, TEXT) as store:
        rows = [(found.row(k), outcome(k)) for k in range(4)]
        store.add(table(schema(found), rows))
        store.finish()
    assert runs(tmp_path)['xy_rms_m'].null_count == runs(tmp_path)['to_1_mm_s'].null_count == 4
    (result,) = results.evaluate(tmp_path / 'runs.parquet', found).values()
    assert result.quantities[0].name == 'joint error, rms'
    assert result.laws['smc'].medians[0].value == pytest.approx(2.0)  # of 1 and 3 urad
    assert [(duel.winner, duel.probability.value) for duel in result.duels] == [('smc', 1.0)]


def test_the_order_of_the_rows_does_not_matter(whole, tmp_path):
    class Backwards(Inline):
        slots = 1000

        def __init__(self):
            self.waiting = []

        def submit(self, task):
            self.waiting.append(task)

        def wait(self):
            task = self.waiting.pop()
            return [(task, run_task(task))]

    swept(tmp_path, workers=Backwards(), count=7)
    assert content(tmp_path) == content(whole)


def test_lost_workers_do_not_stop_others():
    class Losing:
        """Loses every task at first sight."""

        slots = 3

        def __init__(self):
            self.waiting = []

        def submit(self, task):
            self.waiting.append(task)

        def wait(self):
            task = self.waiting.pop(0)
            lost = task.losses == 0 or task.numbers == (4,)
            return [(task, None if lost else [Outcome('ok')] * len(task.numbers))]

    made = [Task('', tuple(range(k, k + 4)), ({},) * 4, '') for k in range(0, 12, 4)]
    found = [
        (number, outcome.status)
        for task, outcomes in completed(Losing(), iter(made))
        for number, outcome in zip(task.numbers, outcomes, strict=True)
    ]
    assert sorted(found) == [(n, 'failed' if n == 4 else 'ok') for n in range(12)]
