"""Metrics of a simulation that comes in parts: of its true motion, and of what is seen of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.running_metrics import Moves, RunningMetrics
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_sim.course import Course, undisturbed
from parallel_robot_sim.ideal_torque import IdealTorque
from parallel_robot_sim.motions import SimulatedMotions, Told
from parallel_robot_sim.simulation import Simulation
from trajectory_gen.trajectory import Reference


class RunningFigures:
    """Those of :func:`metrics.figures` up to rounding, in memory that does not grow."""

    def __init__(self) -> None:
        self._error: ParallelRobotError | None = None
        self._motions: SimulatedMotions | None = None

    def add(self, part: Simulation) -> None:
        """Take the next part; what has no metrics is told at the end."""
        if self._error is not None:
            return
        try:
            if self._motions is None:
                self._begin(part)
            self._add(part)
        except ParallelRobotError as error:
            self._error = error

    def result(self) -> Metrics:
        """The metrics, when all parts are there.

        Raises:
            ParallelRobotError: why there are none.
        """
        if self._error is not None:
            raise self._error
        found = self._true.result()
        rests = found.window.rests or self._rests
        window = found.window._replace(run_s=self._run, rests=rests)
        seen = None if self._seen is None else self._seen.result()
        return found._replace(window=window, seen=seen)

    def _begin(self, part: Simulation) -> None:
        """Look at the desired motion, which says where the windows are."""
        configuration, loop = part.configuration, part.experiment.loop
        self._motions = SimulatedMotions(configuration)
        self._ideal = IdealTorque(configuration.trajectory, configuration.plant)
        whole = Moves()
        for first, reference, _ in _planned(part):
            whole.add(_times(first, len(reference.position), loop.period_ns), reference.position)
        rest = whole.rest
        self._rests, last = rest is not None, loop.last_index or 0
        self._run = loop.period_ns * last / NANOSECONDS
        moves = {each: Moves(np.inf if rest is None else rest) for each in ('true', 'seen')}
        told = None if self._motions.told is None else Told(configuration)
        for first, reference, course in _planned(part):
            time, wanted = (
                _times(first, len(reference.position), loop.period_ns),
                reference.position,
            )
            moves['true'].add(time, wanted)
            if told is not None:
                _, time, wanted = told.reference(course, reference, first, len(wanted))
            moves['seen'].add(time, wanted)
        self._true = RunningMetrics(moves['true'])
        self._seen: RunningMetrics | None = RunningMetrics(moves['seen'])

    def _add(self, part: Simulation) -> None:
        assert self._motions is not None
        stop = part.first + part.run.steps
        motions = self._motions.of(part, self._ideal.between(part.first, stop))
        assert motions.true is not None
        self._true.add(motions.true, motions.ideal)
        if motions.seen is None:
            self._seen = None
        elif self._seen is not None:
            self._seen.add(motions.seen)


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
