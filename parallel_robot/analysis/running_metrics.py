"""Metrics of a run that comes piece by piece, in memory that does not grow with it.

They are those of :mod:`metrics` up to rounding. Where the second half of a motion begins is known
at its end alone: a plan says where it is taken to be, and the end says which plan was right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import (
    BELOW,
    FALLS,
    SEEN,
    SLOW,
    Effort,
    Errors,
    Metrics,
    Torque,
    Transient,
    Window,
    distances,
    rotation_errors,
    rough,
    smooth_over,
)
from parallel_robot.bags.run.run_log import ReferenceMoves
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import HINGES, Array
from parallel_robot_sim.motions import Motion, Motions, Poses

BOUNDS = (1e-3, 1e-4)  # m, see Transient
ROTATED = 6  # of the sums: that of rotation errors, which the end effector has, not each joint


class Halves(NamedTuple):
    """Where the second half of a motion begins, and the second half of that: its samples."""

    half: int
    middle: int


class Plan(NamedTuple):
    """What has to be known of a part of a run before its metrics can be found."""

    # time from which on the best motion rests to the end [s]; infinite where it does not
    end: float = math.inf
    true: Halves | None = None  # halves of the true motion; None where nobody can know
    seen: Halves | None = None  # halves of the motion that was seen


def all_of_it(count: int, first: int = 0) -> Halves:
    """Halves of a motion of so many samples, of which the first ones are at rest."""
    half = (first + count) // 2
    return Halves(half, half + (count - half + 1) // 2)


class RunningMetrics:
    """Metrics of a motion, see :func:`metrics.evaluate`."""

    def __init__(self, halves: Halves | None) -> None:
        """Prepare.

        Args:
            halves: Where its halves are taken to begin; None: its window is all of it.
        """
        self._halves = halves
        self._pending: Motion | None = None
        self._ideal: Array | None = None
        self._done = 0  # samples of the pending ones that are counted
        self._number = 0  # of the first pending one
        self._width = 0  # samples on each side of a moving mean
        self._known = True  # whether all ideal torques are known
        self._first = self._last = self._start = math.nan
        self._units = HINGES
        self._largest = 0.0
        self._variation: list[float] = []
        self._since = [math.nan] * len(BOUNDS)  # NaN: from the next sample on
        self._was_above = [False] * len(BOUNDS)
        self._nowhere = False
        self._moves = ReferenceMoves()
        self._fastest = self._speed = 0.0
        self._sums: list[tuple[float, ...]] = []
        self._farthest = self._most_rotated = -math.inf
        self._halved: tuple[list[float], list[float]] = ([], [])
        self._in_halves = [0, 0]
        self._in_window = 0
        self._excess: list[tuple[Array, Array, Array, Array]] = []

    def add(self, motion: Motion, ideal: Array | None) -> None:
        """Take the next samples; `ideal` torques [N m], shape (N, n), None: not known."""
        if not len(motion.time):
            return
        self._known &= ideal is not None
        if self._pending is None:
            self._width = smooth_over(motion.time)
            self._first, self._units = float(motion.time[0]), motion.poses.units
            self._pending, self._ideal = motion, ideal
        else:
            self._pending = joined((self._pending, motion))
            if self._known:
                assert self._ideal is not None and ideal is not None
                self._ideal = np.concatenate((self._ideal, ideal))
            self._take(len(self._pending.time) - self._width)
        self._moves.add(motion.time, motion.reference_position)
        self._last = float(motion.time[-1])

    @property
    def count(self) -> int:
        """Number of samples."""
        return self._moves.rows

    def finish(self, ended: bool) -> tuple[Metrics, float | None, Halves | None]:
        """Tell what was found.

        Args:
            ended: Whether it is known that the motion ends here.

        Returns:
            The metrics; the time from which on the motion rests to the end [s], None where it
            does not; the halves it has.
        """
        if self._pending is not None:
            self._take(len(self._pending.time))
            self._pending = None
        first, rest = self._moves.first, self._moves.rest
        count = self.count if ended or rest is None else self._moves.last + 1
        length = self._last - self._first
        errors, effort = self._averages()
        found = Metrics(
            length,
            Transient(*(self._settled(k) for k in range(len(BOUNDS)))),
            errors,
            Torque(
                self._largest,
                math.fsum(self._variation) / length if length else 0.0,
                self._rms(3),
            ),
            effort,
            window=Window(
                self._start,
                self._last,
                length,
                rests=self._halves is not None and first > 0,
                falls=self._falls(),
            ),
            units=self._units,
        )
        return found, rest, self._halves and all_of_it(count, first)

    def _take(self, stop: int) -> None:
        """Count the pending samples before one; what later ones do not need is given up."""
        if self._pending is None or stop <= self._done:
            return
        self._of_motion(self._pending, self._done, stop)
        self._of_window(self._pending, self._done, stop)
        kept = slice(max(0, stop - self._width - 1), None)
        self._number += kept.start
        self._done = stop - kept.start
        self._pending = self._pending.rows(kept)
        self._ideal = None if self._ideal is None else self._ideal[kept]

    def _of_motion(self, motion: Motion, begin: int, stop: int) -> None:
        """What is of all samples."""
        rows, time = slice(begin, stop), motion.time
        self._largest = max(self._largest, float(np.abs(motion.effort[rows]).max()))
        since = slice(max(begin - 1, 0), stop)
        self._variation.append(float(np.abs(np.diff(motion.effort[since], axis=0)).sum()))
        distance = distances(motion.poses)[rows]
        self._nowhere |= bool(np.isnan(distance).any())
        for k, bound in enumerate(BOUNDS):
            above = np.flatnonzero(distance >= bound)
            if above.size:
                self._was_above[k], self._since[k] = True, math.nan
                if above[-1] + 1 < len(distance):
                    self._since[k] = float(time[begin + above[-1] + 1])
            elif math.isnan(self._since[k]):
                self._since[k] = float(time[begin])
        steps = np.diff(motion.reference_position[since], axis=0)
        if len(steps):
            speeds = np.abs(steps).max(axis=1)
            self._fastest = max(self._fastest, float(speeds.max()))
            self._speed = float(speeds[-1])

    def _of_window(self, motion: Motion, begin: int, stop: int) -> None:
        """What is of the second half alone."""
        half, middle = (0, 0) if self._halves is None else self._halves
        chosen = slice(max(begin, half - self._number), stop)
        if chosen.start >= stop:
            return
        if not self._in_window:
            self._start = float(motion.time[chosen.start])
        self._in_window += stop - chosen.start
        error = (motion.reference_position - motion.position)[chosen]
        distance = distances(motion.poses)[chosen]
        self._farthest = max(self._farthest, float(distance.max()))
        if np.isnan(distance).any():
            self._farthest = math.nan
        moved = np.diff(motion.position, axis=0, prepend=motion.position[:1])
        found = rough(motion.effort, self._width)[chosen]
        work = float(np.abs(motion.effort * moved)[chosen].sum())
        squares = (distance, error, synchronisation_error(error), found, motion.effort[chosen])
        rotation = rotation_errors(motion.poses)[chosen]
        self._most_rotated = float(np.maximum(self._most_rotated, rotation.max()))  # NaN stays
        rotated = float(np.sum(rotation**2))
        self._sums.append((*(float(np.sum(each**2)) for each in squares), work, rotated))
        at = min(max(middle - self._number - chosen.start, 0), len(error))
        for k, part in enumerate((error[:at], error[at:])):
            self._halved[k].append(float(np.sum(part**2)))
            self._in_halves[k] += part.size
        if self._known and self._ideal is not None:
            useful = rough(self._ideal, self._width)[chosen]
            most = np.sum(useful**2, axis=0)
            share = _share(np.sum(found * useful, axis=0), most)
            left = found - share * useful
            alike = np.sum(left * useful, axis=0)
            self._excess.append((share, most, alike, np.sum(left**2, axis=0)))
        self._joints = error.shape[1]

    def _averages(self) -> tuple[Errors, Effort]:
        if not self._in_window:
            nothing = math.nan
            return Errors(nothing, nothing, nothing, nothing), Effort()
        work = math.fsum(sums[5] for sums in self._sums)
        errors = Errors(self._rms(0), self._farthest, self._rms(1), self._rms(2))
        if not math.isnan(self._most_rotated):
            errors = errors._replace(
                rotation_rms_rad=self._rms(ROTATED), rotation_max_rad=self._most_rotated
            )
        return errors, Effort(self._rms(4), work, self._least())

    def _rms(self, column: int) -> float:
        of_joints = column not in (0, ROTATED)
        count = self._in_window * (self._joints if of_joints else 1) if self._in_window else 0
        sums = math.fsum(sums[column] for sums in self._sums)
        return math.sqrt(sums / count) if count else math.nan

    def _least(self) -> float:
        """See :func:`metrics.excess_chattering`, from what each piece leaves by its own share."""
        if not self._known:
            return math.nan
        shares, most, alike, left = (np.array(each) for each in zip(*self._excess, strict=True))
        share = _share(np.sum(alike + shares * most, axis=0), np.sum(most, axis=0))
        more = shares - share
        rest = left + 2.0 * more * alike + more**2 * most
        return math.sqrt(math.fsum(rest.ravel()) / (self._in_window * self._joints))

    def _settled(self, k: int) -> float | None:
        """See :func:`metrics._settled`."""
        if self._nowhere:
            return math.nan
        if not self._was_above[k]:
            return 0.0
        since = self._since[k]
        return since - self._first if self._last - since >= BELOW - 1e-9 else None

    def _falls(self) -> tuple[float, float] | None:
        """See :func:`metrics._falls`."""
        if self._halves is None or self._speed < SLOW * self._fastest:
            return None
        before, after = (
            math.sqrt(math.fsum(sums) / count) if count else 0.0
            for sums, count in zip(self._halved, self._in_halves, strict=True)
        )
        return (before, after) if before > FALLS * after > 0.0 else None


class RunningFigures:
    """Metrics of a part of a run, see :func:`metrics.figures`."""

    def __init__(self, begin: float, end: float, asked: bool, plan: Plan) -> None:
        """Prepare.

        Args:
            begin: Its begin [s].
            end: Its end, not in it [s].
            asked: Whether all metrics are of all of it.
            plan: What is taken to be so.
        """
        self._begin, self._end, self._asked, self._plan = begin, end, asked, plan
        self._true = RunningMetrics(self._of(plan.true))
        self._seen = RunningMetrics(self._of(plan.seen))
        self._first = self._last = math.nan

    def _of(self, halves: Halves | None) -> Halves | None:
        return None if self._asked else halves or Halves(0, 0)

    def add(self, motions: Motions) -> None:
        """Take the next part of the run."""
        part = motions.between(self._begin, self._end)
        if not len(part.best.time):
            return
        if math.isnan(self._first):
            self._first = float(part.best.time[0])
        self._last = float(part.best.time[-1])
        part = part.between(-math.inf, np.nextafter(self._plan.end, math.inf))
        if part.true is not None:
            self._true.add(part.true, part.ideal)
        if part.seen is not None:
            self._seen.add(part.seen, None)

    @property
    def count(self) -> int:
        """Samples of its best motion up to the end of the plan."""
        return self._true.count or self._seen.count

    @property
    def last(self) -> float:
        """Time of its last sample [s]."""
        return self._last

    def finish(self) -> tuple[Metrics, Plan]:
        """The metrics, and the plan that would have been right: they are good if it was used."""
        ended = math.isfinite(self._plan.end)
        true, rest, halves = self._true.finish(ended)
        seen, seen_rest, seen_halves = self._seen.finish(ended)
        if not self._true.count:
            rest, found = seen_rest, seen._replace(source=SEEN, seen=seen)
        else:
            found = true._replace(seen=seen if self._seen.count else None)
        plan = Plan(
            self._plan.end if ended or rest is None or self._asked else rest,
            halves if self._true.count else self._plan.true,
            seen_halves if self._seen.count else self._plan.seen,
        )
        window = found.window._replace(
            run_s=self._last - self._first,
            asked=self._asked,
            rests=found.window.rests or math.isfinite(plan.end),
        )
        return found._replace(window=window), plan


def _share(alike: Array, most: Array) -> Array:
    shares = np.divide(alike, most, out=np.zeros_like(most), where=most > 0.0)
    return np.clip(shares, 0.0, 1.0)


def joined(parts: Sequence[Motion]) -> Motion:
    """Parts of a motion that follow each other."""
    poses = [part.poses for part in parts]
    return Motion(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.position for part in parts]),
        np.concatenate([part.reference_position for part in parts]),
        np.concatenate([part.effort for part in parts]),
        Poses(
            np.concatenate([pose.actual for pose in poses]),
            np.concatenate([pose.reference for pose in poses]),
            *poses[0][2:],
        ),
    )
