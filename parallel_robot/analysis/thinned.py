"""A motion with as many samples as can be seen."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

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
WINDOW = 20.0  # s of a long motion, of which the extremes of a curve are found at once, or more


class Series(NamedTuple):
    """Values over time."""

    time: np.ndarray  # since t = 0 [s], shape (N,)
    values: np.ndarray  # one column for each joint, shape (N, n)


class Track(NamedTuple):
    """A path; poses that are not numbers end a line, where a part is left out."""

    time: np.ndarray  # since t = 0 [s], shape (N,)
    poses: Poses  # poses of end effector and reference


def windows(time: np.ndarray) -> list[slice]:
    """Rows of equal times of WINDOW or more, of INTERVALS at most; `time` [s], shape (N,)."""
    each = max(WINDOW, float(time[-1] - time[0]) / INTERVALS)
    first, last = (int(end // each) for end in (time[0], time[-1]))
    bounds = [0, *np.searchsorted(time, each * np.arange(first + 1, last + 1)), len(time)]
    return [slice(*ends) for ends in pairwise(bounds) if ends[0] < ends[1]]


def long_path(motion: Motion) -> Track:
    """Parts of a path that is long, evenly spread over it; the first window is whole."""
    parts, due = [], np.inf  # s, of the next part
    for rows in windows(motion.time):
        due += PATH * (rows.stop - rows.start) / len(motion.time)
        if due >= SHORTEST:
            parts.append(path_of(motion.rows(rows), due))
            due = 0.0
    times, poses = zip(*parts, strict=True)
    actual, reference = (
        np.concatenate([getattr(one, name) for one in poses]) for name in ('actual', 'reference')
    )
    return Track(np.concatenate(times), poses[0]._replace(actual=actual, reference=reference))


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


def thinned(motion: Motion) -> Motion:
    """The samples of a motion at which a curve that is drawn of it has an extreme."""
    found = [np.flatnonzero(motion.time <= FIRST), np.array([len(motion.time) - 1])]
    for rows in windows(motion.time):
        part = motion.rows(rows)
        error = part.reference_position - part.position
        curves = [error, synchronisation_error(error), part.effort]
        place = part.poses.place
        if place:
            reference, actual = part.poses.reference[:, :place], part.poses.actual[:, :place]
            curves += [reference, reference - actual, distances(part.poses)[:, np.newaxis]]
        if part.poses.rotation_components:
            curves.append(rotation_errors(part.poses)[:, np.newaxis])
        found += _extreme_rows(curves, rows, len(motion.time))
    return motion.rows(np.unique(np.concatenate(found)))


def thinned_series(series: Series) -> Series:
    """The rows of some curves at which one has an extreme."""
    time, values = series
    found = [
        row for rows in windows(time) for row in _extreme_rows([values[rows]], rows, len(time))
    ]
    chosen = np.unique(np.concatenate(found))
    return Series(time[chosen], values[chosen])


def _extreme_rows(curves: Sequence[np.ndarray], rows: slice, count: int) -> list[np.ndarray]:
    """The first and last of some rows of a long curve, and those with extremes of curves."""
    intervals = max(1, round(INTERVALS * (rows.stop - rows.start) / count))
    ends = np.array([rows.start, rows.stop - 1])
    return [ends, *(rows.start + extremes(c, intervals) for each in curves for c in each.T)]
