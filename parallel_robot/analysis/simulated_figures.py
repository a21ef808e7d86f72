"""Metrics of a simulation that comes in parts: of its true motion, and of what is seen of it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.reference_moves import ReferenceMoves
from parallel_robot.analysis.running_metrics import Plan, RunningFigures, all_of_it
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_sim.course import Course, undisturbed
from parallel_robot_sim.ideal_torque import IdealTorque
from parallel_robot_sim.motions import SimulatedMotions, Told
from parallel_robot_sim.simulation import Simulation
from trajectory_gen.trajectory import Reference


class SimulatedFigures:
    """Those of :func:`metrics.figures` up to rounding, in memory that does not grow."""

    def __init__(self) -> None:
        """Begin before the first part."""
        self._error: ParallelRobotError | None = None
        self._motions: SimulatedMotions | None = None
        self._seen = True  # so far

    def add(self, part: Simulation) -> None:
        """Take the next part; what has no metrics is told at the end."""
        if self._error is not None:
            return
        try:
            if self._motions is None:
                configuration = part.configuration
                self._motions = SimulatedMotions(configuration)
                self._ideal = IdealTorque(configuration.trajectory, configuration.plant)
                plan = _plan(part, None if self._motions.told is None else Told(configuration))
                self._figures = RunningFigures(-math.inf, math.inf, False, plan)
            stop = part.first + part.run.steps
            motions = self._motions.of(part, self._ideal.between(part.first, stop))
            self._seen &= motions.seen is not None
            self._figures.add(motions)
        except ParallelRobotError as error:
            self._error = error

    def result(self) -> Metrics:
        """The metrics, when all parts are there.

        Raises:
            ParallelRobotError: why there are none.
        """
        if self._error is not None:
            raise self._error
        found, _ = self._figures.finish()
        return found if self._seen else found._replace(seen=None)


def _plan(part: Simulation, told: Told | None) -> Plan:
    """Where the windows of a run are, as its desired motion says."""
    period = part.experiment.loop.period_ns
    whole = ReferenceMoves()
    for first, reference, _ in _planned(part):
        whole.add(_times(first, len(reference.position), period), reference.position)
    end = math.inf if whole.rest is None else whole.rest
    true, seen = ReferenceMoves(end), ReferenceMoves(end)
    for first, reference, course in _planned(part):
        time, wanted = _times(first, len(reference.position), period), reference.position
        true.add(time, wanted)
        if told is not None:
            _, time, wanted = told.reference(course, reference, first, len(wanted))
        seen.add(time, wanted)
    return Plan(end, *(all_of_it(moves.rows, moves.first) for moves in (true, seen)))


def _planned(part: Simulation) -> Iterator[tuple[int, Reference, Course]]:
    """First sample, desired motion and course of all parts of a run, from the first part."""
    loop, size = part.experiment.loop, len(part.reference.position)
    yield 0, part.reference, part.course
    for first in range(size, (loop.last_index or 0) + 1, size):
        stop = min(first + size, (loop.last_index or 0) + 1)
        reference = part.experiment.trajectory.sample(np.arange(first, stop) * loop.period)
        yield first, reference, undisturbed(reference, loop.period)


def _times(first: int, count: int, period_ns: int) -> np.ndarray:
    """Times of samples [s], as stamps tell them."""
    return period_ns * (first + np.arange(count)) / NANOSECONDS
