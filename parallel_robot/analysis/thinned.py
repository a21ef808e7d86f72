"""A motion with as many samples as can be seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from parallel_robot.analysis.metrics import distances, rotation_errors
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_sim.motions import Motion, Poses

# Fewer points of a curve, with all its spikes.

MOST = 100_000  # values of a curve that grows
INTERVALS = 1500  # of a curve; two points of each are finer than the dots of a page


def extremes(
    values: np.ndarray, intervals: int = INTERVALS, times: np.ndarray | None = None
) -> np.ndarray:
    """Choose the smallest and the largest value in each of equal intervals.

    Args:
        values: A curve, shape (N,).
        intervals: Number of intervals.
        times: Of the values, in rising order, shape (N,); None: at equal distances.

    Returns:
        Indices in rising order, a pair for each interval that has a value; all N if they are not
        more than two for each.
    """
    if len(values) <= 2 * intervals:
        return np.arange(len(values))
    bounds = np.linspace(0, len(values), intervals + 1).astype(int)
    if times is not None:
        bounds[1:-1] = np.searchsorted(
            times, np.linspace(times[0], times[-1], intervals + 1)[1:-1]
        )
    pairs = [
        (start + np.argmin(values[start:end]), start + np.argmax(values[start:end]))
        for start, end in pairwise(bounds)
        if start < end
    ]
    return np.sort(np.array(pairs), axis=1).ravel()


class Curves:
    """Curves that grow; of long ones, what can be seen."""

    def __init__(self) -> None:
        self.time = np.zeros(0)  # of the values that are kept [s], shape (N,)
        self.values = np.zeros((0, 0))  # of each curve, shape (N, c)

    def add(self, time: np.ndarray, values: np.ndarray) -> None:
        """Append values; `time` as of :attr:`time`, `values` as of :attr:`values`."""
        if len(self.time):
            time, values = np.append(self.time, time), np.vstack([self.values, values])
        if len(time) > MOST:
            kept = [extremes(column, times=time) for column in np.nan_to_num(values).T]
            rows = np.unique(np.concatenate([*kept, [0, len(time) - 1]]))
            time, values = time[rows], values[rows]
        self.time, self.values = time, values


def envelope(values: np.ndarray) -> np.ndarray:
    """Largest magnitude in each pair of neighbours, for both, shape (N,).

    For a decimated curve it is that of the interval, without dips where the curve crosses zero.
    """
    even = len(values) - len(values) % 2
    pairs = np.abs(values[:even]).reshape(-1, 2).max(axis=1)
    return np.concatenate([np.repeat(pairs, 2), np.abs(values[even:])])


STEP = 0.01  # s, between two samples of a path
FIRST = 1.0  # s, in which the torques are far larger than afterwards: all samples are kept
PATH = 600.0  # s, of which the path of a long run is drawn
SHORTEST = 2.0  # s of a part of it
Part = TypeVar('Part')


class Series(NamedTuple):
    """Values over time."""

    time: np.ndarray  # since t = 0 [s], shape (N,)
    values: np.ndarray  # one column for each joint, shape (N, n)


class Track(NamedTuple):
    """A path; poses that are not numbers end a line, where a part is left out."""

    time: np.ndarray  # since t = 0 [s], shape (N,)
    poses: Poses  # poses of end effector and reference


class Growing(Generic[Part]):
    """Parts that follow each other, each thinned to its share; of very many, less of each."""

    def __init__(
        self, thin: Callable[[Part, int], Part], join: Callable[[Sequence[Part]], Part]
    ) -> None:
        """Begin empty.

        Args:
            thin: Keeps the extremes of so many intervals of a part.
            join: Puts parts together.
        """
        self._thin, self._join = thin, join
        self._parts: list[Part] = []
        self._each = 1  # how many were put together in each
        self._last = 1  # the same of the last one

    def add(self, part: Part, share: float) -> None:
        """Take the next part, which is such a share of the whole."""
        part = self._thin(part, max(1, round(INTERVALS * share)))
        if self._last < self._each:
            self._parts[-1] = self._one([*self._parts[-1:], part])
            self._last += 1
        else:
            self._parts.append(part)
            self._last = 1
        if len(self._parts) == 2 * INTERVALS:
            pairs = (self._parts[k : k + 2] for k in range(0, 2 * INTERVALS, 2))
            self._parts = [*map(self._one, pairs)]
            self._each, self._last = 2 * self._each, 2 * self._each

    def _one(self, parts: Sequence[Part]) -> Part:
        return self._thin(self._join(parts), 1)

    def whole(self) -> Part | None:
        """All of it; None without parts."""
        return self._join(self._parts) if self._parts else None


class GrowingTrack:
    """Parts of a path that is long, evenly spread over it."""

    def __init__(self) -> None:
        self._parts: list[Track] = []
        self._due = np.inf  # s, of the next part; the first one is whole

    def add(self, motion: Motion, share: float) -> None:
        """Take the next part of a motion, which is such a share of the whole."""
        self._due += PATH * share
        if self._due >= SHORTEST:
            self._parts.append(path_of(motion, self._due))
            self._due = 0.0

    def whole(self) -> Track:
        """What is kept of it."""
        times, poses = zip(*self._parts, strict=True)
        actual, reference = (
            np.concatenate([getattr(one, name) for one in poses])
            for name in ('actual', 'reference')
        )
        return Track(np.concatenate(times), Poses(actual, reference, *poses[0][2:]))


def path_of(motion: Motion, seconds: float) -> Track:
    """Poses without gaps around the largest error of a motion, and one that ends the line.

    Args:
        motion: The motion.
        seconds: For how long [s].
    """
    poses, time = motion.poses, motion.time
    worst = time[np.argmax(distances(poses))] if poses.place else time[0]
    begin = max(min(worst - 0.5 * seconds, time[-1] - seconds), time[0])
    stop = min(begin + seconds, time[-1])
    times = np.arange(begin, stop, STEP)
    chosen = np.unique(np.searchsorted(time, times))
    end = np.full((1, poses.actual.shape[1]), np.nan)
    return Track(
        np.append(time[chosen], stop),
        Poses(
            np.concatenate((poses.actual[chosen], end)),
            np.concatenate((poses.reference[chosen], end)),
            *poses[2:],
        ),
    )


def thinned(motion: Motion, intervals: int) -> Motion:
    """The samples of a motion at which a curve that is drawn of it has an extreme.

    Args:
        motion: The motion.
        intervals: Number of equal intervals, of each of which the extremes are kept.
    """
    error = motion.reference_position - motion.position
    curves = [error, synchronisation_error(error), motion.effort]
    place = motion.poses.place
    if place:
        reference, actual = motion.poses.reference[:, :place], motion.poses.actual[:, :place]
        curves += [reference, reference - actual, distances(motion.poses)[:, np.newaxis]]
    if motion.poses.rotation_components:
        curves.append(rotation_errors(motion.poses)[:, np.newaxis])
    always = [np.array([0, len(motion.time) - 1]), np.flatnonzero(motion.time <= FIRST)]
    return motion.rows(np.unique(np.concatenate([*always, *_rows(curves, intervals)])))


def thinned_series(series: Series, intervals: int) -> Series:
    """The rows of some curves at which one has an extreme; arguments as of :func:`thinned`."""
    rows = np.unique(np.concatenate(_rows([series.values], intervals)))
    return Series(series.time[rows], series.values[rows])


def joined_series(parts: Sequence[Series]) -> Series:
    """Curves that follow each other."""
    times, values = zip(*parts, strict=True)
    return Series(np.concatenate(times), np.concatenate(values))


def _rows(curves: Sequence[np.ndarray], intervals: int) -> list[np.ndarray]:
    return [extremes(column, intervals) for values in curves for column in values.T]
