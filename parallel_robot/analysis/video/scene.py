"""What a video shows of a run at each of its frames, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import distances
from parallel_robot.analysis.report.runs import Run
from parallel_robot.analysis.report.space_views import oblique
from parallel_robot.bags.run import recorded_robot
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.motions import Motion, Poses

MOST = 4  # runs side by side
SMALLEST = 1e-3  # m, size of a path
SEEN = 0.08  # of the path's size: the largest error of the second half, magnified


class Scene(NamedTuple):
    """One run as a video shows it; what is in space is seen obliquely.

    Attributes:
        run: The run.
        now: Its samples at the frames, shape (F, ...).
        rows: Row of its motion at each frame, shape (F,).
        path_rows: Row of its path at each frame, shape (F,).
        parts: Name of each part of the robot to the ends of its lines [m], shape (F, L, 2, 2).
        reference: Desired path of the end effector [m], NaN where it is left out, shape (P, 2).
        actual: Its path [m], likewise, shape (P, 2).
        path: Its path with magnified errors [m], likewise, shape (P, 2).
        error: Distances from the reference [m], shape (N,).
    """

    run: Run
    now: Motion
    rows: np.ndarray
    path_rows: np.ndarray
    parts: dict[str, np.ndarray]
    reference: np.ndarray
    actual: np.ndarray
    path: np.ndarray
    error: np.ndarray


def frame_times(runs: Sequence[Run], rate: float, speed: float, most: int) -> np.ndarray:
    """Times of the frames, from the first run's begin to the last one's end [s], shape (F,).

    Args:
        runs: The runs.
        rate: Frames of a second of the video [Hz].
        speed: Seconds of the motion in a second of the video.
        most: How many they may be.

    Raises:
        InputError: they are more.
    """
    begin = max(0.0, min(float(run.motion.time[0]) for run in runs))
    end = max(float(run.motion.time[-1]) for run in runs)
    count = int((end - begin) * rate / speed) + 1
    if count > most:
        raise InputError(
            f'{end - begin:g} s of motion are {count} frames, more than {most} of such a file; '
            'raise --speed or lower --rate'
        )
    return np.minimum(begin + np.arange(count) * speed / rate, end)


def magnification(runs: Sequence[Run]) -> float:
    """How much to magnify the errors of all runs alike: 1, 2 or 5 times a power of ten.

    The largest of the second half of all runs then takes a small part of the picture. Not at all
    where one has no distance.
    """
    poses = [run.motion.poses for run in runs]
    if len({pose.place for pose in poses}) > 1 or not poses[0].place:
        return 1.0
    largest = max(float(distances(pose)[len(pose.actual) // 2 :].max()) for pose in poses)
    places = np.concatenate([pose.reference[:, : pose.place] for pose in poses])
    size = max(float(np.ptp(places, axis=0).max()), SMALLEST)
    return max(1.0, _round_below(SEEN * size / largest)) if largest > 0.0 else 1.0


def scene(run: Run, times: np.ndarray, magnified: float) -> Scene:
    """What a video shows of a run; one that is shorter stays at its end.

    Args:
        run: The run.
        times: Of the frames [s], shape (F,).
        magnified: By how much its errors are magnified.

    Raises:
        BagError: its robot is not known here.
        InputError: its pose is not a place.
    """
    unknown = recorded_robot.unknown(run.log.config)
    if unknown:
        raise BagError(f'{run.bag}: {unknown}')
    if not run.motion.poses.place:
        raise InputError(
            f'{run.bag}: the pose of its robot is not a place; there is no video of it'
        )
    now, robot = run.at(times), robot_of(run.log.config)
    parts = robot.module.segments(robot.parameters, now.poses.actual, now.position)
    rows, path_rows = (
        np.searchsorted(each.time, now.time, side='right') - 1 for each in (run.motion, run.path)
    )
    poses = run.path.poses
    if poses.in_space:
        parts = {part: oblique(ends) for part, ends in parts.items()}
    reference, actual, path = (enlarged(poses, factor) for factor in (0.0, 1.0, magnified))
    error = distances(run.motion.poses)
    return Scene(run, now, rows, path_rows, parts, reference, actual, path, error)


def enlarged(poses: Poses, magnified: float) -> np.ndarray:
    """Places of an end effector with magnified errors as a video shows them [m], shape (N, 2)."""
    reference = poses.reference[:, : poses.place]
    places = np.asarray(reference + magnified * (poses.actual[:, : poses.place] - reference))
    return oblique(places) if poses.in_space else places


def _round_below(value: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= value))
