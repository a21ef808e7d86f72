"""A motion with as many samples as can be seen."""

from __future__ import annotations

import numpy as np

from parallel_robot.analysis.metrics import distances
from parallel_robot.analysis.report.decimation import extremes
from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_sim.motions import Motion, Poses

STEP = 0.01  # s, between two samples of a path


def path_of(motion: Motion, seconds: float) -> Poses:
    """Poses without gaps around the largest error of a motion, and one that ends the line.

    Args:
        motion: The motion.
        seconds: For how long [s].
    """
    poses, time = motion.poses, motion.time
    worst = time[np.argmax(distances(poses))] if poses.planar else time[0]
    begin = max(min(worst - 0.5 * seconds, time[-1] - seconds), time[0])
    times = np.arange(begin, min(begin + seconds, time[-1]), STEP)
    chosen = np.unique(np.searchsorted(time, times))
    end = np.full((1, poses.actual.shape[1]), np.nan)
    return Poses(
        np.concatenate((poses.actual[chosen], end)),
        np.concatenate((poses.reference[chosen], end)),
        poses.planar,
    )


def thinned(motion: Motion, intervals: int) -> Motion:
    """The samples of a motion at which a curve that is drawn of it has an extreme.

    Args:
        motion: The motion.
        intervals: Number of equal intervals, of each of which the extremes are kept.
    """
    error = motion.reference_position - motion.position
    curves = [error, synchronisation_error(error), motion.effort]
    if motion.poses.planar:
        reference, actual = motion.poses.reference[:, :2], motion.poses.actual[:, :2]
        curves += [reference, reference - actual, distances(motion.poses)[:, np.newaxis]]
    columns = [column for values in curves for column in values.T]
    ends = np.array([0, len(motion.time) - 1])
    rows = np.unique(np.concatenate([ends, *(extremes(each, intervals) for each in columns)]))
    return motion.rows(rows)
