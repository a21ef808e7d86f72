"""Metrics of a run that comes in parts, from sums: up to rounding those of its arrays."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot.analysis.metrics import (
    BELOW,
    FALLS,
    SLOW,
    Effort,
    Errors,
    Metrics,
    Torque,
    Transient,
    Window,
    distances,
    half_width,
    moving_mean,
    steps,
)
from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_sim.motions import Motion

BOUNDS = (1e-3, 1e-4)  # m, of a transient


class Moves:
    """Where the reference of a run moves, part by part.

    Attributes:
        rows: Number of its samples.
    """

    def __init__(self, end: float = math.inf) -> None:
        """Begin; `end`: time up to which the run is looked at [s]."""
        self.rows = 0
        self._end = np.nextafter(end, math.inf)
        self._before = np.empty((0, 0))  # the last row
        self._last_time = math.nan
        self._count = 0
        self._first = self._after = 0  # samples: before the first move, after the last one
        self._first_time = self._after_time = math.nan

    def add(self, time: np.ndarray, reference: np.ndarray) -> None:
        """Take the next part: times [s], shape (N,), desired positions [rad], shape (N, n)."""
        count = int(np.searchsorted(time, self._end))
        if not count:
            return
        time, known = time[:count], reference[:count]
        if self.rows:
            known = np.vstack([self._before, known])
        moves = np.flatnonzero(np.diff(known, axis=0).any(axis=1))
        if moves.size:
            back = len(known) - count
            times = np.concatenate([np.full(back, self._last_time), time])
            if not self._count:
                self._first = self.rows - back + int(moves[0])
                self._first_time = float(times[moves[0]])
            self._after = self.rows - back + int(moves[-1]) + 1
            self._after_time = float(times[moves[-1] + 1])
            self._count += moves.size
        self._before, self._last_time = known[-1:], float(time[-1])
        self.rows += count

    @property
    def first(self) -> int:
        """Sample from which on it moves; 0 where it does not."""
        return self._first if self._moves else 0

    @property
    def rest(self) -> float | None:
        """Time from which on it rests to the end [s]; None where it moves on."""
        return self._after_time if self._moves and self._after + 1 < self.rows else None

    @property
    def _moves(self) -> bool:
        lasts, samples = self._after_time - self._first_time, self._after - self._first
        return bool(self._count) and not steps(lasts, samples, self._count)


class RunningMetrics:
    """Metrics of a run, part by part; those of :func:`metrics.evaluate` up to rounding."""

    def __init__(self, moves: Moves) -> None:
        """Begin a run whose reference moves so."""
        self._first, self._count = moves.first, moves.rows
        self._half = (moves.first + moves.rows) // 2  # the window is from there on
        self._middle = self._half + (self._count - self._half + 1) // 2
        self._rows = 0
        self._times = math.nan, math.nan, math.nan  # of the first row, of the window, the last
        self._since: list[float | None] = [0.0] * len(BOUNDS)  # s, since the begin; None: not yet
        self._distance = np.zeros(2)  # sum of squares, largest
        self._errors = np.zeros((2, 2))  # halves of the window: sums of squares, numbers
        self._sync = 0.0
        self._speed = np.zeros(2)  # of the reference: the last one, largest
        self._most, self._variation = 0.0, 0.0  # of the torque
        self._squares, self._work = 0.0, 0.0
        self._last = np.empty(0)  # last row of positions, references and torques
        self._width = 0  # of the moving mean, half of it
        self._torques = np.empty((0, 0))  # the last ones, beside the ideal ones
        self._begun = 0  # sample of the first of them
        self._rough = np.zeros((3, 1))  # sums of squares and product of both, by joint

    def add(self, motion: Motion, ideal: np.ndarray | None = None) -> None:
        """Take the next part, and its ideal torques where they are known [N m], shape (N, n)."""
        count = min(len(motion.time), self._count - self._rows)
        if count <= 0:
            return
        self._add(
            motion.time[:count],
            np.stack(
                [
                    each[:count]
                    for each in (motion.position, motion.reference_position, motion.effort)
                ],
                axis=1,
            ),
            distances(motion.poses)[:count],
            None if ideal is None else ideal[:count],
        )
        self._rows += count

    def _add(
        self, time: np.ndarray, moved: np.ndarray, distance: np.ndarray, ideal: np.ndarray | None
    ) -> None:
        """Take a part; `moved`: positions, references and torques, shape (N, 3, n)."""
        # 1. Times.
        window = slice(max(self._half - self._rows, 0), None)
        begin, middle, _ = self._times
        begin = begin if self._rows else float(time[0])
        if self._rows <= self._half < self._rows + len(time):
            middle = float(time[window][0])
        self._times = begin, middle, float(time[-1])
        for k, bound in enumerate(BOUNDS):
            if self._since[k] is None:
                self._since[k] = float(time[0]) - begin
            above = np.flatnonzero(~(distance < bound))
            if above.size:
                after = above[-1] + 1
                self._since[k] = float(time[after]) - begin if after < len(time) else None
        # 2. Errors in the window.
        position, reference, effort = moved.swapaxes(0, 1)
        error = reference - position
        far, wrong = distance[window], error[window]
        if far.size:
            self._distance += (far @ far, 0.0)
            self._distance[1] = np.maximum(self._distance[1], far.max())  # NaN stays
            self._sync += float(np.sum(synchronisation_error(wrong) ** 2))
        halves = np.split(
            error, np.clip([self._half - self._rows, self._middle - self._rows], 0, None)
        )
        for sums, half in zip(self._errors, halves[1:], strict=True):
            sums += np.sum(half**2), half.size
        # 3. Changes, also from the part before.
        known = np.concatenate([self._last, moved]) if self._rows else moved
        changes = np.abs(np.diff(known, axis=0))
        if len(changes):
            speeds = changes[:, 1].max(axis=1)
            self._speed[:] = speeds[-1], max(self._speed[1], speeds.max())
            self._variation += float(changes[:, 2].sum())
            work = np.abs(effort[-len(changes) :]) * changes[:, 0]
            skipped = max(self._half - self._rows - (len(time) - len(changes)), 0)
            self._work += float(work[skipped:].sum())
        self._last = moved[-1:]
        # 4. Torques.
        self._most = max(self._most, float(np.abs(effort).max()))
        self._squares += float(np.sum(effort[window] ** 2))
        both = np.hstack([effort, np.zeros_like(effort) if ideal is None else ideal])
        if not self._rows:
            self._width = half_width(time)
            self._torques, self._begun = np.repeat(both[:1], self._width, axis=0), -self._width
            self._known_ideal = ideal is not None
            self._rough = np.zeros((3, effort.shape[1]))
        self._chatter(both)

    def _chatter(self, both: np.ndarray) -> None:
        """Take torques and ideal torques, as far as there are so many after them."""
        half = self._width
        known = np.vstack([self._torques, both])
        inner = known[half : len(known) - half]
        if not len(inner):
            self._torques = known
            return
        rough = inner - moving_mean(known, half)
        rough = rough[max(self._half - (self._begun + half), 0) :]
        found, useful = np.hsplit(rough, 2)
        self._rough += [np.sum(each, axis=0) for each in (found**2, useful**2, found * useful)]
        self._torques, self._begun = known[len(inner) :], self._begun + len(inner)

    def result(self) -> Metrics:
        """The metrics, when all parts are there."""
        self._chatter(np.repeat(self._torques[-1:], self._width, axis=0))
        begin, start, stop = self._times
        duration, samples = stop - begin, self._count - self._half
        numbers = float(self._errors[:, 1].sum())
        distance, largest = self._distance
        found, useful, alike = self._rough
        share = np.divide(alike, useful, out=np.zeros_like(useful), where=useful > 0.0)
        share = np.clip(share, 0.0, 1.0)
        excess = float(np.sum(found - 2.0 * share * alike + share**2 * useful))
        settled = [self._settled(since, math.isnan(distance), duration) for since in self._since]
        return Metrics(
            duration,
            Transient(*settled),
            Errors(
                math.sqrt(distance / samples),
                float(largest),
                math.sqrt(self._errors[:, 0].sum() / numbers),
                math.sqrt(self._sync / numbers),
            ),
            Torque(
                self._most,
                self._variation / duration if duration else 0.0,
                math.sqrt(found.sum() / numbers),
            ),
            Effort(
                math.sqrt(self._squares / numbers),
                self._work,
                math.sqrt(max(excess, 0.0) / numbers) if self._known_ideal else math.nan,
            ),
            window=Window(start, stop, duration, rests=self._first > 0, falls=self._falls()),
        )

    def _settled(self, since: float | None, unknown: bool, duration: float) -> float | None:
        if unknown:
            return math.nan
        stays = since is not None and (not since or duration - since >= BELOW - 1e-9)
        return since if stays else None

    def _falls(self) -> tuple[float, float] | None:
        last, largest = self._speed
        if last < SLOW * largest:
            return None  # errors fall with the speed
        before, after = (math.sqrt(total / n) if n else 0.0 for total, n in self._errors)
        return (before, after) if before > FALLS * after > 0.0 else None
