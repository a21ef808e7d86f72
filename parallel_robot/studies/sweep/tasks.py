"""The work of a sweep in pieces, each small enough to be lost, and how a worker does one."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.experiment import software
from parallel_robot.studies.sweep.floor import calm_of, floor_of
from parallel_robot.studies.sweep.plan import Plan, Row
from parallel_robot.studies.sweep.run_chunk import Outcome, failed, run_chunk
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import RunError
from parallel_robot_model.processes import cache_directory
from parallel_robot_sim.configuration import configure

MOST_ROWS, LEAST_ROWS = 32, 4  # in one task, but for the last
MOST_STATES = 400_000  # of the runs of a task: a few seconds of work
TASKS_EACH = 4  # at least, for each worker


@dataclass(frozen=True)
class Task:
    """Runs of one law in one scenario.

    Attributes:
        scenario: Name of the scenario, or the path of its file.
        numbers: Numbers of the rows.
        overrides: What each row changes in the configuration.
        version: Version of the code that is to run it, see :func:`version`.
        limited: Whether the limit of each sample is asked for: it is the same for all laws of a
            scenario, so the rows of the first one tell it.
        calm: Whether its price of calm is asked for, too.
        losses: How many workers were lost over it.
    """

    scenario: str
    numbers: tuple[int, ...]
    overrides: tuple[Mapping[str, Any], ...]
    version: str
    limited: bool = False
    calm: bool = False
    losses: int = 0

    def split(self) -> list[Task]:
        """A task for each row, after the worker that had all of them was lost."""
        return [
            replace(self, numbers=(number,), overrides=(overrides,), losses=self.losses + 1)
            for number, overrides in zip(self.numbers, self.overrides, strict=True)
        ]


def tasks(plan: Plan, done: NDArray[np.bool_], workers: int) -> Iterator[Task]:
    """The tasks that are left of a plan, sample after sample.

    Args:
        plan: The plan.
        done: Which rows are done, shape (rows,).
        workers: Number of workers that share them.
    """
    samples, cases = plan.study.runs, len(plan.cases)
    states = max(1, round(plan.durations[-1] / float(plan.cases[0].nominal['period'])))
    first, left = 0, len(done) - int(done.sum())
    while first < samples:
        # Smaller tasks towards the end, so that no worker waits long for the last one.
        size = max(LEAST_ROWS, min(MOST_ROWS, left // (TASKS_EACH * workers)))
        count = min(size, max(1, MOST_STATES // states), samples - first)
        for case in range(cases):
            missing = ~done[first * cases + case : (first + count) * cases : cases]
            left -= int(missing.sum())
            if missing.any():
                rows = plan.rows(case, first, count)
                needed = [row for row, lacks in zip(rows, missing, strict=True) if lacks]
                leads = plan.leader(case) == case
                yield task(needed, limited=leads, calm=leads and plan.study.calm)
        first += count


def task(rows: list[Row], limited: bool = False, calm: bool = False) -> Task:
    """The task of some rows of one case; `limited`, `calm`: with the limit of each sample."""
    return Task(
        rows[0].scenario,
        tuple(row.row for row in rows),
        tuple(row.overrides for row in rows),
        version(),
        limited,
        calm,
    )


@functools.cache
def version() -> str:
    """Version of the code that makes the numbers; equal code has the same, wherever it lies."""
    return f'{software()["version"]} {cache_directory.suite_hash()}'


def run_task(task: Task) -> list[Outcome]:
    """Run a task in a worker.

    Raises:
        RunError: this worker has another version of the code.
    """
    if task.version != version():
        raise RunError(
            f'a worker has another version of the suite: {version()}, not {task.version}'
        )
    with _LOCK:
        found: dict[int, Any] = {}
        for k, overrides in enumerate(task.overrides):
            try:
                found[k] = configure(resolve(task.scenario, overrides))
            except Exception as error:  # impossible values, and whatever custom modules raise
                found[k] = failed(error)
        good = {k: each for k, each in found.items() if not isinstance(each, Outcome)}
        found |= dict(zip(good, run_chunk(list(good.values())), strict=True))
        if task.limited:
            for k, configuration in good.items():
                found[k] = replace(found[k], floor=floor_of(configuration))
        if task.calm:
            for k, configuration in good.items():
                found[k] = replace(found[k], calm=calm_of(configuration))
        return list(found.values())


_LOCK = threading.Lock()  # a worker of a cluster may have several threads; they share the above
