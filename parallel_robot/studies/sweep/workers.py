"""Who runs the tasks of a sweep: processes on this machine, or a cluster."""

from __future__ import annotations

import contextlib
import os
import subprocess
import tempfile
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import IO, Protocol

from parallel_robot.studies.sweep.run_chunk import Outcome, Task
from parallel_robot_model.common.errors import RunError
from parallel_robot_model.processes.child_process import command, die_with_parent

MODULE = 'parallel_robot.studies.sweep.worker'
ONE_THREAD = {
    f'{name}_NUM_THREADS': '1' for name in ('NUMBA', 'OMP', 'OPENBLAS', 'MKL', 'VECLIB_MAXIMUM')
}
MOST_LOSSES = 3  # workers that one row may cost
MOST_UNREADY = 10  # processes that may be killed before they are ready
END_TIMEOUT = 5.0  # s, until a worker that is told to end is killed


class Workers(Protocol):
    """Workers that run tasks; a context manager, at whose end they are given up."""

    def __enter__(self) -> Workers:
        """Reach them; processes start with their first tasks."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give them up, with the tasks that they still have."""

    @property
    def slots(self) -> int:
        """Number of tasks that keep all of them busy."""

    def submit(self, task: Task) -> None:
        """Give a task to one of them."""

    def wait(self) -> list[tuple[Task, list[Outcome] | None]]:
        """Wait for a task; returns those that ended, None where the worker was lost.

        Raises:
            RunError: workers cannot run tasks at all.
        """


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
            elif len(task.numbers) == 1 and task.losses + 1 >= MOST_LOSSES:
                reason = f'the worker process that ran it was lost, {MOST_LOSSES} times'
                yield task, [Outcome('failed', reason)]
            else:
                again += task.split()


@dataclass
class _Worker:
    """A worker process.

    Attributes:
        process: The process.
        pipe: This end of its pipe.
        log: What it writes.
        ready: Whether it has started.
        task: What it is working at.
    """

    process: subprocess.Popen[bytes]
    pipe: Connection
    log: IO[bytes]
    ready: bool = False
    task: Task | None = None


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
        """Start none yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes."""
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
        """Wait for a task, see :class:`Workers`."""
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
        """Start another process in place of a lost one.

        Raises:
            RunError: it ended before it was ready, so another would, too.
        """
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
