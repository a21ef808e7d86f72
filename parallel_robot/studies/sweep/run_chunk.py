"""Runs of one law in one scenario, and their metrics."""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis import metrics
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.bags.experiment import software
from parallel_robot.studies.calm import WHOLE, Calm, least_error
from parallel_robot.studies.sweep.plan import Plan, Row
from parallel_robot_control import assembly as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.configuration import resolve
from parallel_robot_control.messages import limits_text
from parallel_robot_model.common.errors import DRIVEN_OUT, ParallelRobotError, RunError, first_line
from parallel_robot_model.processes import cache_directory
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import Configuration, Experiment, assemble_plant, configure
from parallel_robot_sim.motions import of_simulation
from parallel_robot_sim.simulation import Simulation
from trajectory_gen import preflight
from trajectory_gen.trajectory import Reference, Trajectory

# The limit of a sample of a study: what no law can do better on its robot.


class Floor(NamedTuple):
    """The limit of a sample; the names are those of the columns."""

    limit_um: float = math.nan  # least end-effector error of any law [um]; NaN without a plane
    # least joint error, of a robot without a plane [urad]; NaN with one
    limit_urad: float = math.nan
    # distance that the reference travels while a state is late [um], see LeastError
    delay_um: float = math.nan
    limit_reason: str = ''  # why there is no limit; empty if there is one


def floor_of(configuration: Configuration) -> Floor:
    """The limit of an experiment, whatever its law; a reason in place of an error."""
    try:
        found = least_error(configuration, causes=False)
    except Exception as error:  # custom robots raise anything
        return Floor(limit_reason=first_line(error))
    limit, delay = 1e6 * found.errors[WHOLE], 1e6 * found.travelled
    if not math.isfinite(limit):
        return Floor(delay_um=delay, limit_reason='the linear model of the motion is not finite')
    if configuration.true_robot.place:
        return Floor(limit_um=limit, delay_um=delay)
    return Floor(limit_urad=limit, delay_um=delay)


def calm_of(configuration: Configuration) -> Calm | None:
    """The limit of an experiment by chattering; None where there is none."""
    try:
        return least_error(configuration, causes=False, calm=True).calm
    except Exception:  # custom robots raise anything
        return None


Status = Literal['ok', 'fault', 'failed']


@dataclass(frozen=True)
class Outcome:
    """What became of a run."""

    status: Status  # ok; fault: the controller took its safe action; failed: there are no metrics
    reason: str = ''  # why it is not ok; empty if it is
    limits: str = ''  # limits that acted
    metrics: Metrics | None = None  # metrics of the run
    floor: Floor | None = None  # limit of its sample, where it was asked for
    # limit of its sample by chattering, where it was asked for and there is one
    calm: Calm | None = None


def run_chunk(configurations: Sequence[Configuration]) -> list[Outcome]:
    """Run experiments and measure them as ``analyze`` measures their bags.

    Args:
        configurations: Experiments of one law in one scenario.

    Returns:
        One outcome for each; a run that fails does not stop the others.
    """
    outcomes: list[Outcome] = []
    controller: Control | None = None
    for k, configuration in enumerate(configurations):
        try:
            if controller is None or configuration.made_of != configurations[k - 1].made_of:
                controller = control.assemble(configuration)
            outcomes.append(_run(configuration, controller))
        except Exception as error:  # custom laws raise anything
            outcomes.append(failed(error))
            controller = None
    return outcomes


def failed(error: Exception) -> Outcome:
    """The outcome of a run that raised an error."""
    known = isinstance(error, ParallelRobotError)
    return Outcome('failed', str(error) if known else first_line(error))


def _run(configuration: Configuration, controller: Control) -> Outcome:
    """Do a run and measure it."""
    loop, trajectory = configuration.loop, configuration.trajectory
    reference = _reference(trajectory, loop.period, loop.last_index or 0)
    experiment = Experiment(loop, trajectory, controller, assemble_plant(configuration))
    last = loop.last_index or 0
    result = run(experiment.control, experiment.plant, reference, loop.period, complete=False)
    if result.steps <= last:
        raise RunError(f'{DRIVEN_OUT} after t = {(result.steps - 1) * loop.period:.3f} s')
    made = Simulation(configuration, experiment, reference, result, 0.0)
    found = metrics.figures(of_simulation(made))
    acted = int(np.bitwise_or.reduce(result.active_limits))
    limits = limits_text(acted) if acted else ''
    if made.fault is not None:
        begin, fault = made.fault
        return Outcome('fault', f'fault at t = {begin:.3f} s: {fault.text}', limits, found)
    return Outcome('ok', '', limits, found)


@functools.lru_cache(maxsize=2)
def _reference(trajectory: Trajectory, period: float, last: int) -> Reference:
    """The motion of a trajectory, checked and sampled once for all runs that share it."""
    reference = trajectory.sample(np.arange(last + 1) * period)
    preflight.check(trajectory, period, reference)
    return reference


# The work of a sweep in pieces, each small enough to be lost, and how a worker does one.

MOST_ROWS, LEAST_ROWS = 32, 4  # in one task, but for the last
MOST_STATES = 400_000  # of the runs of a task: a few seconds of work
TASKS_EACH = 4  # at least, for each worker


@functools.cache
def version() -> str:
    """Version of the code that makes the numbers; equal code has the same, wherever it lies."""
    return f'{software()["version"]} {cache_directory.suite_hash()}'


@dataclass(frozen=True)
class Task:
    """Runs of one law in one scenario."""

    rows: tuple[Row, ...]
    # version of the code that is to run it
    version: str = field(default_factory=version)
    # whether the limit of each sample is asked for: it is the same for all laws of a
    # scenario, so the rows of the first one tell it
    limited: bool = False
    calm: bool = False  # whether its price of calm is asked for, too
    losses: int = 0  # how many workers were lost over it

    def split(self) -> list[Task]:
        """A task for each row, after the worker that had all of them was lost."""
        return [replace(self, rows=(row,), losses=self.losses + 1) for row in self.rows]


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
                needed = tuple(row for row, lacks in zip(rows, missing, strict=True) if lacks)
                leads = plan.leader(case) == case
                yield Task(needed, limited=leads, calm=leads and plan.study.calm)
        first += count


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
        found: list[Configuration | Outcome] = []
        for row in task.rows:
            try:
                found.append(configure(resolve(row.scenario, row.overrides)))
            except Exception as error:  # impossible values, and whatever custom modules raise
                found.append(failed(error))
        good = [each for each in found if not isinstance(each, Outcome)]
        done = iter(run_chunk(good))
        return [
            each
            if isinstance(each, Outcome)
            else replace(
                next(done),
                floor=floor_of(each) if task.limited else None,
                calm=calm_of(each) if task.calm else None,
            )
            for each in found
        ]


_LOCK = threading.Lock()  # a worker of a cluster may have several threads; they share the above
