"""A cluster that runs the tasks of a sweep, by dask.distributed."""

from __future__ import annotations

import contextlib
import logging
import queue
from typing import Any

from parallel_robot.studies.sweep.run_chunk import Outcome, Task, run_task
from parallel_robot.studies.sweep.workers import MOST_LOSSES
from parallel_robot_model.common.errors import InputError, RunError, first_line

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
        try:
            import distributed  # optional
        except ImportError:
            raise InputError(
                "--scheduler needs dask.distributed; pip install 'dask[distributed]'"
            ) from None
        self._distributed: Any = distributed
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
        """Wait for a task, see :class:`Workers`."""
        while True:
            with contextlib.suppress(queue.Empty):
                future = self._ended.get(timeout=HEARTBEAT)
                return [(self._tasks[future], self._result(future))]
            if self._client.status != 'running':
                raise RunError(f'the scheduler {self._address} is gone; finished rows are kept')

    def _result(self, future: Any) -> list[Outcome] | None:
        """Outcomes of a task that ended; None when it cost several workers.

        Raises:
            RunError: the scheduler is gone, or workers cannot run the task.
        """
        task = self._tasks.pop(future)
        error = future.exception() if future.status == 'error' else None
        if isinstance(error, self._distributed.KilledWorker):
            if len(task.numbers) == 1:
                reason = f'the worker process that ran it was lost, {MOST_LOSSES} times'
                return [Outcome('failed', reason)]
            return None
        if error is not None:
            raise RunError(f'a worker of the cluster failed: {first_line(error)}')
        if future.status != 'finished':
            raise RunError(f'the scheduler {self._address} gave up a task: {future.status}')
        outcomes: list[Outcome] = future.result()
        return outcomes
