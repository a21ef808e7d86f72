"""Sweeps: every row once, whatever is killed or full."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from bags import full_disk
from ros_fixtures import PATIENCE
from sweeping import ROWS, RUNS, TEXT, content, planned, runs, swept

from parallel_robot.cli.command_line import main
from parallel_robot.studies.sweep.plan import Row
from parallel_robot.studies.sweep.run_chunk import Outcome, Task, run_task, tasks
from parallel_robot.studies.sweep.store import Store, schema, table
from parallel_robot.studies.sweep.workers import MOST_LOSSES, Processes, completed
from parallel_robot_model.common.errors import RunError

pytest_plugins = ['sweeping']

ROOT = Path(__file__).parents[1]


def test_two_processes_make_the_same_file(whole, tmp_path):
    with_processes = tmp_path / 'processes'
    swept(with_processes, workers=Processes(2))
    assert content(with_processes) == content(whole)


def row(number):
    return Row(number, number, 'paper_circle', 'pid', 0, {}, {})


def numbers(task):
    return tuple(each.row for each in task.rows)


def test_there_are_no_more_processes_than_tasks(monkeypatch):
    idle = SimpleNamespace(ready=False, task=None)
    monkeypatch.setattr('parallel_robot.studies.sweep.workers._start', lambda: idle)
    workers = Processes(1000)
    for count in (1, 2, 3):
        workers.submit(Task((row(count),)))
        assert len(workers._workers) == count


STRUCK = """
import os, signal, sys
from pathlib import Path
from parallel_robot.cli.command_line import main
from parallel_robot.studies.sweep.store import Store

add, number, pid = Store.add, int(sys.argv.pop(1)), os.getpid()

def struck(store, rows):
    Store.add = add
    add(store, rows)
    print(Path(f'/proc/{pid}/task/{pid}/children').read_text(), flush=True)
    os.kill(pid, number)

signal.signal(signal.SIGINT, signal.default_int_handler)  # it may be ignored in the background
Store.add = struck
sys.exit(main())
"""


def command(out, *words, signal):
    """A sweep as a process, which prints its workers and gets a signal when it has added rows."""
    file = out.with_suffix('.yaml')
    file.write_text(TEXT)
    return [
        sys.executable,
        '-c',
        STRUCK,
        str(signal),
        'sweep',
        str(file),
        '--out',
        str(out),
        *words,
    ]


def runs_on(pid):
    stat = Path(f'/proc/{pid}/stat')
    return stat.exists() and stat.read_text().rpartition(')')[2].split()[0] != 'Z'


def until(condition, seconds=PATIENCE):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


@pytest.mark.endurance
def test_a_sweep_that_is_killed_twice_ends_as_one_that_ran_through(whole, tmp_path, capsys):
    out = tmp_path / 'killed'
    parts = out / 'parts'
    for _ in range(2):
        before = set(parts.glob('*.parquet'))
        words = command(out, '--workers', '2', signal=int(signal.SIGKILL))
        killed = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        workers = killed.stdout.split()
        assert (
            killed.returncode == -signal.SIGKILL
            and len(workers) == 2
            and until(lambda pids=workers: not any(map(runs_on, pids)))
        )
        assert before < set(parts.glob('*.parquet')) and not (out / 'runs.parquet').exists()
    words = ['sweep', str(out.with_suffix('.yaml')), '--out', str(out), '--workers', '1']
    assert main(words) == 0
    said, error = capsys.readouterr()
    assert error == '' and f'{RUNS} runs of each law and scenario' in said
    assert content(out) == content(whole)


@pytest.mark.endurance
def test_ctrl_c_says_what_is_kept(tmp_path):
    out = tmp_path / 'interrupted'
    words = command(out, signal=int(signal.SIGINT))
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 130 and done.stderr.count('\n') == 1
    assert f'of {ROWS} rows are kept, the same command continues' in done.stderr


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


@pytest.mark.endurance
def test_the_rows_of_killed_workers_are_run_again(whole, tmp_path):
    workers = Killing(2)
    swept(tmp_path / 'killed', workers=workers)
    assert len(workers.victims) == 2
    assert content(tmp_path / 'killed') == content(whole)


class Deadly:
    """A value that ends the process that takes it out of a pipe."""

    def __reduce__(self):
        return os._exit, (9,)


@pytest.mark.endurance
def test_a_row_that_kills_its_workers_is_a_failure_and_no_other_row_is():
    good = next(tasks(planned(), np.zeros(ROWS, dtype=bool), 2))
    deadly = replace(good.rows[2], overrides={'x': Deadly()})
    bad = Task((*good.rows[:2], deadly))
    with Processes(2) as workers:
        found = {
            numbers(task): outcomes for task, outcomes in completed(workers, iter([bad, good]))
        }
    assert set(found) == {numbers(good), *((number,) for number in numbers(bad))}
    statuses = [found[(number,)][0].status for number in numbers(bad)]
    assert statuses == ['ok', 'ok', 'failed']
    assert found[(deadly.row,)][0].reason.endswith(f'was lost, {MOST_LOSSES} times')
    assert found[numbers(good)][2] != found[(deadly.row,)][0]


def test_workers_that_cannot_start_end_the_sweep_with_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr('parallel_robot.studies.sweep.workers.MODULE', 'parallel_robot_missing')
    with pytest.raises(RunError, match=r'cannot start: .*parallel_robot_missing'):
        swept(tmp_path / 'out', workers=Processes(2))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('room', 'kept'), [('a part', 10), ('the table', ROWS), ('a picture', ROWS)]
)
def test_a_full_disk_costs_one_line_and_no_row(room, kept, whole, tmp_path, capsys):
    file, out = tmp_path / 'study.yaml', tmp_path / 'out'
    file.write_text(TEXT)
    swept(out, runs=5)
    before = content(out)
    most = len(content(whole)) - 100
    with full_disk({'a part': 4096, 'the table': most, 'a picture': most + 200}[room]):
        assert main(['sweep', str(file), '--out', str(out), '--workers', '1']) == 1
    error = capsys.readouterr().err
    said = 'all rows are kept' if room == 'a picture' else f'{kept} of {ROWS} rows are kept'
    assert 'cannot write' in error and said in error and error.count('\n') == 1
    assert content(out) == (content(whole) if room == 'a picture' else before)
    assert not list(out.rglob('*.unfinished'))
    swept(out)
    assert content(out) == content(whole)


def test_a_part_that_is_cut_off_is_run_again(whole, tmp_path):
    found = planned()
    with Store(tmp_path, found, TEXT) as store:
        for task in list(tasks(found, store.done, 2))[:4]:
            store.add(table(schema(found), zip(task.rows, run_task(task), strict=True)))
        done = int(store.done.sum())
        assert 0 < done < ROWS
    part = min((tmp_path / 'parts').iterdir())
    part.write_bytes(part.read_bytes()[:-20])
    (tmp_path / 'parts' / 'x.parquet.unfinished').write_bytes(b'')
    with Store(tmp_path, found, TEXT) as store:
        assert 0 < store.done.sum() < done
    swept(tmp_path)
    assert content(tmp_path) == content(whole)


def test_a_sweep_that_was_killed_after_its_rows_were_merged(whole, tmp_path):
    swept(tmp_path)
    found = planned()
    (tmp_path / 'parts').mkdir()
    pq.write_table(
        runs(tmp_path).slice(7, 20), tmp_path / 'parts' / '0000000007_0000000026_20.parquet'
    )
    with Store(tmp_path, found, TEXT) as store:
        assert store.done.all()
        store.finish()
    assert content(tmp_path) == content(whole) and not (tmp_path / 'parts').exists()


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
            lost = task.losses == 0 or numbers(task) == (4,)
            return [(task, None if lost else [Outcome('ok')] * len(task.rows))]

    made = [Task(tuple(map(row, range(k, k + 4)))) for k in range(0, 12, 4)]
    found = [
        (number, outcome.status)
        for task, outcomes in completed(Losing(), iter(made))
        for number, outcome in zip(numbers(task), outcomes, strict=True)
    ]
    assert sorted(found) == [(n, 'failed' if n == 4 else 'ok') for n in range(12)]
