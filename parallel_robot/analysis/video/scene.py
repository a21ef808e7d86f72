"""What a video shows of a run at each of its frames, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import distances
from parallel_robot.analysis.report.animation import box
from parallel_robot.analysis.report.runs import Run
from parallel_robot.bags import recorded_robot
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.robots.configuration import robot_of

MOST = 4  # runs side by side
SEEN = 0.08  # of the path's size: the largest error of the second half, magnified


class Scene(NamedTuple):
    """One run as a video shows it.

    Attributes:
        run: The run.
        rows: Row of the log at each frame, shape (F,).
        parts: Name of each part of the robot to the ends of its lines [m], shape (F, L, 2, 2).
        reference: Desired path of the end effector [m], shape (N, 2).
        path: Its path with magnified errors [m], shape (N, 2).
        error: Distances from the reference [m], shape (N,).
    """

    run: Run
    rows: np.ndarray
    parts: dict[str, np.ndarray]
    reference: np.ndarray
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

    The largest of the second half of all runs then takes a small part of the picture.
    """
    poses = [run.motion.poses for run in runs]
    largest = max(float(distances(pose)[len(pose.actual) // 2 :].max()) for pose in poses)
    size = box(np.concatenate([pose.reference[:, :2] for pose in poses]), 0.0)[2]
    return max(1.0, _round_below(SEEN * size / largest)) if largest > 0.0 else 1.0


def scene(run: Run, times: np.ndarray, magnified: float) -> Scene:
    """What a video shows of a run; one that is shorter stays at its end.

    Args:
        run: The run.
        times: Of the frames [s], shape (F,).
        magnified: By how much its errors are magnified.

    Raises:
        BagError: its robot is not known here.
        InputError: it does not move in a plane.
    """
    unknown = recorded_robot.unknown(run.log.config)
    if unknown:
        raise BagError(f'{run.bag}: {unknown}')
    if not run.motion.poses.planar:
        raise InputError(f'{run.bag}: its robot does not move in a plane; there is no video of it')
    rows = np.clip(np.searchsorted(run.motion.time, times), 0, len(run.motion.time) - 1)
    robot, actual = robot_of(run.log.config), run.motion.poses.actual
    parts = robot.module.segments(robot.parameters, actual[rows], run.motion.position[rows])
    reference = run.motion.poses.reference[:, :2]
    path = reference + magnified * (actual[:, :2] - reference)
    return Scene(run, rows, parts, reference, path, distances(run.motion.poses))


def _round_below(value: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= value))
