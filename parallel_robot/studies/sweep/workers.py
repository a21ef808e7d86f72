"""Who runs the tasks of a sweep: processes on this machine, or a cluster."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import IO, Any, TypeAlias

from parallel_robot.studies.sweep.run_chunk import Outcome, Task, run_task
from parallel_robot_model.common.errors import InputError, RunError, first_line, optional
from parallel_robot_model.processes.child_process import command, die_with_parent

MODULE = 'parallel_robot.studies.sweep.workers'
ONE_THREAD = {
    f'{name}_NUM_THREADS': '1' for name in ('NUMBA', 'OMP', 'OPENBLAS', 'MKL', 'VECLIB_MAXIMUM')
}
MOST_LOSSES = 3  # workers that one row may cost
MOST_UNREADY = 10  # processes that may be killed before they are ready
END_TIMEOUT = 5.0  # s, until a worker that is told to end is killed


def completed(workers: Workers, tasks: Iterator[Task]) -> Iterator[tuple[Task, list[Outcome]]]:
    """Run tasks in any order.

    A task whose worker was lost, e.g. killed when memory ran out, is run again row by row; a row
    over which MOST_LOSSES workers were lost is a failure.

    Raises:
        RunError: workers cannot run tasks at all.
    """
    again: deque[Task] = deque()
    running = 0
    while True:
        while running < workers.slots:
            task = again.popleft() if again else next(tasks, None)
            if task is None:
                break
            workers.submit(task)
            running += 1
        if not running:
            return
        for task, outcomes in workers.wait():
            running -= 1
            if outcomes is not None:
                yield task, outcomes
            elif len(task.rows) == 1 and task.losses + 1 >= MOST_LOSSES:
                reason = f'the worker process that ran it was lost, {MOST_LOSSES} times'
                yield task, [Outcome('failed', reason)]
            else:
                again += task.split()


@dataclass
class _Worker:
    """A worker process."""

    process: subprocess.Popen[bytes]
    pipe: Connection  # this end of its pipe
    log: IO[bytes]  # what it writes
    ready: bool = False  # whether it has started
    task: Task | None = None  # what it is working at


class Processes:
    """Worker processes on this machine, one thread each; no more than there are tasks."""

    def __init__(self, count: int) -> None:
        """Prepare at most `count` processes."""
        self._count = count
        self._workers: list[_Worker] = []
        self._queue: deque[Task] = deque()
        self._unready = 0  # processes that were killed before they were ready

    @property
    def slots(self) -> int:
        """One task for each, and one that it finds when it is done."""
        return 2 * self._count

    @property
    def pids(self) -> list[int]:
        """Process identifiers."""
        return [worker.process.pid for worker in self._workers]

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.process.kill()  # they write nothing: there is nothing to tidy up
            worker.pipe.close()
            worker.log.close()
        for worker in self._workers:
            with contextlib.suppress(subprocess.TimeoutExpired):
                worker.process.wait(END_TIMEOUT)

    def submit(self, task: Task) -> None:
        """Give a task to the first process that is free."""
        self._queue.append(task)
        tasks = len(self._queue) + sum(worker.task is not None for worker in self._workers)
        if len(self._workers) < min(self._count, tasks):
            self._workers.append(_start())
        self._distribute()

    def wait(self) -> list[tuple[Task, list[Outcome] | None]]:
        """Wait for a task; return those that ended, None where the worker was lost.

        Raises:
            RunError: workers cannot run tasks at all.
        """
        ended: list[tuple[Task, list[Outcome] | None]] = []
        while not ended:
            pipes = {worker.pipe: worker for worker in self._workers}
            for pipe in wait(list(pipes)):
                worker = pipes[pipe]  # type: ignore[index]
                try:
                    answer = worker.pipe.recv()
                except (EOFError, OSError):
                    self._replace(worker)
                    if worker.task is not None:
                        ended.append((worker.task, None))
                    continue
                if isinstance(answer, str):
                    raise RunError(answer)
                if worker.task is not None:
                    ended.append((worker.task, answer))
                    worker.task = None
                worker.ready = True
            self._distribute()
        return ended

    def _distribute(self) -> None:
        for worker in self._workers:
            if self._queue and worker.ready and worker.task is None:
                worker.task = self._queue.popleft()
                with contextlib.suppress(OSError):  # lost just now: its end is read by wait()
                    worker.pipe.send(worker.task)

    def _replace(self, worker: _Worker) -> None:
        """Start another process in place of a lost one."""
        worker.process.wait()
        worker.pipe.close()
        with worker.log as log:
            log.seek(0)
            lines = log.read().decode(errors='replace').split('\n')
        self._unready += not worker.ready
        if not worker.ready and (worker.process.returncode >= 0 or self._unready > MOST_UNREADY):
            last = next((line for line in reversed(lines) if line.strip()), '')
            reason = last.strip() or f'exit code {worker.process.returncode}'
            raise RunError(f'a worker process cannot start: {reason}')
        self._workers[self._workers.index(worker)] = _start()


def _start() -> _Worker:
    """Start a worker process."""
    ours, theirs = Pipe()
    log = tempfile.TemporaryFile()  # noqa: SIM115, it is closed with its worker
    with theirs:
        process = subprocess.Popen(
            command(MODULE, str(theirs.fileno())),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env={**os.environ, **ONE_THREAD},
            pass_fds=(theirs.fileno(),),
            start_new_session=True,  # Ctrl-C is for the sweep, which ends them
            preexec_fn=die_with_parent,
        )
    return _Worker(process, ours, log)


# A cluster that runs the tasks of a sweep, by dask.distributed.

PATIENCE = 10.0  # s, to reach the scheduler
HEARTBEAT = 1.0  # s, between two looks whether it is still there
AHEAD = 2  # tasks for each thread of the cluster


class Cluster:
    """The workers of a dask scheduler. Tasks of lost workers are run again by the scheduler."""

    def __init__(self, address: str) -> None:
        """Prepare to use the scheduler at an address, e.g. ``tcp://head:8786``.

        Raises:
            InputError: dask.distributed is not installed.
        """
        lacking = "--scheduler needs dask.distributed; pip install 'dask[distributed]'"
        self._distributed: Any = optional('distributed', lacking)
        self._address = address
        self._client: Any = None
        self._tasks: dict[Any, Task] = {}
        self._threads = 1
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    @property
    def slots(self) -> int:
        """Some tasks for each thread."""
        if self._client.status == 'running':
            with contextlib.suppress(Exception):  # the scheduler may be gone: wait() says so
                count = self._client.sync(self._client.scheduler.ncores, callback_timeout=1.0)
                self._threads = max(1, sum(count.values()))
        return AHEAD * self._threads

    def __enter__(self) -> Cluster:
        """Connect to the scheduler.

        Raises:
            InputError: it cannot be reached.
        """
        logging.getLogger('distributed').setLevel(logging.CRITICAL)  # errors come as exceptions
        try:
            self._client = self._distributed.Client(
                self._address, timeout=PATIENCE, set_as_default=False
            )
        except (OSError, ValueError, TypeError, TimeoutError) as error:
            reason = first_line(error)
            raise InputError(f'--scheduler: cannot reach {self._address}: {reason}') from None
        return self

    def __exit__(self, *_: object) -> None:
        """Give up what still runs and leave the cluster as it was."""
        for future in self._tasks:
            future.cancel()
        self._client.close()

    def submit(self, task: Task) -> None:
        """Give a task to the scheduler."""
        future = self._client.submit(run_task, task, pure=False)
        self._tasks[future] = task
        future.add_done_callback(self._ended.put)

    def wait(self) -> list[tuple[Task, list[Outcome] | None]]:
        """Wait for a task, see :meth:`Processes.wait`."""
        while True:
            with contextlib.suppress(queue.Empty):
                future = self._ended.get(timeout=HEARTBEAT)
                return [(self._tasks[future], self._result(future))]
            if self._client.status != 'running':
                raise RunError(f'the scheduler {self._address} is gone; finished rows are kept')

    def _result(self, future: Any) -> list[Outcome] | None:
        """Outcomes of a task that ended; None when it cost several workers."""
        task = self._tasks.pop(future)
        error = future.exception() if future.status == 'error' else None
        if isinstance(error, self._distributed.KilledWorker):
            if len(task.rows) == 1:
                reason = f'the worker process that ran it was lost, {MOST_LOSSES} times'
                return [Outcome('failed', reason)]
            return None
        if error is not None:
            raise RunError(f'a worker of the cluster failed: {first_line(error)}')
        if future.status != 'finished':
            raise RunError(f'the scheduler {self._address} gave up a task: {future.status}')
        return future.result()


Workers: TypeAlias = Processes | Cluster


# A worker process of a sweep: it runs the tasks that come through a pipe.


def main(descriptor: int) -> None:
    """Answer tasks until the other end of the pipe is closed.

    Args:
        descriptor: File descriptor of this end.
    """
    pipe: Connection = Connection(descriptor)
    try:
        pipe.send(None)  # ready
        while True:
            task = pipe.recv()
            try:
                answer = run_task(task)
            except Exception as error:
                pipe.send(first_line(error))
            else:
                pipe.send(answer)
    except (EOFError, OSError):  # the sweep has ended
        return


if __name__ == '__main__':
    main(int(sys.argv[1]))
