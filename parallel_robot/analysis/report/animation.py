"""The moving robot as numbers, and as plain data for the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis.report.plots import packed
from parallel_robot.analysis.report.runs import Run
from parallel_robot_model.robots.configuration import robot_of

RATE = 50.0  # Hz, of the frames
MOST = 1500  # frames of a long run


class Postures(NamedTuple):
    """A robot that moves in a plane, in all runs at common times.

    Attributes:
        time: Times of the frames [s], shape (F,).
        parts: Parts of the robot, each name and number of lines.
        frames: For each run the numbers of its frames [m], shape (F, K): x, y of the reference,
            of the end effector, and of both ends of each line, part by part. A run that is
            shorter stays at its end.
    """

    time: np.ndarray
    parts: list[tuple[str, int]]
    frames: list[np.ndarray]


def postures(runs: Sequence[Run], rate: float = RATE) -> Postures:
    """Postures of all runs of a robot that moves in a plane, at most MOST.

    Args:
        runs: The runs.
        rate: Of the frames [Hz].
    """
    duration = max(float(run.motion.time[-1]) for run in runs)
    count = min(MOST, int(duration * rate) + 1)
    times = np.linspace(0.0, duration, count)
    parts: list[tuple[str, int]] = []
    all_frames = []
    for run in runs:
        robot = robot_of(run.log.config)
        rows = np.clip(np.searchsorted(run.motion.time, times), 0, len(run.motion.time) - 1)
        pose = run.motion.poses.actual[rows]
        segments = robot.module.segments(robot.parameters, pose, run.motion.position[rows])
        parts = [(part, ends.shape[1]) for part, ends in segments.items()]
        points = (run.motion.poses.reference[rows, :2], pose[:, :2], *segments.values())
        all_frames.append(np.hstack([part.reshape(count, -1) for part in points]))
    return Postures(times, parts, all_frames)


def animation(runs: Sequence[Run]) -> dict[str, Any]:
    """Postures of all runs of a robot that moves in a plane, for the page.

    Returns:
        ``step`` between frames [s] and ``count`` of them, ``parts`` of the robot, the ``view`` of
        the whole robot and the ``detail`` of the path as x, y, width, height [m], and the
        ``runs``, whose frames are packed; see :class:`Postures`.
    """
    times, parts, all_frames = postures(runs)
    together = np.concatenate(all_frames)
    return {
        'step': float(times[-1]) / max(len(times) - 1, 1),
        'count': len(times),
        'parts': parts,
        'view': box(together.reshape(-1, 2), 0.05),
        'detail': box(together[:, :4].reshape(-1, 2), 0.12),
        'runs': [
            {'style': run.style, 'frames': packed(frames)}
            for run, frames in zip(runs, all_frames, strict=True)
        ],
    }


def box(points: np.ndarray, margin: float) -> list[float]:
    """Square around points [m, m, m, m]: x, y of a corner, width, height."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float((high - low).max()) * (1.0 + 2.0 * margin), 1e-3)
    x, y = (low + high) / 2.0 - size / 2.0
    return [float(x), float(y), size, size]
