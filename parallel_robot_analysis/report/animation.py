"""The moving robot as plain data for the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_analysis.report.plots import packed
from parallel_robot_analysis.report.runs import Run
from parallel_robot_model.robots import robot_of

RATE = 50.0  # Hz, of the frames
MOST = 1500  # frames of a long run


def animation(runs: Sequence[Run]) -> dict[str, Any]:
    """Postures of all runs of a robot that moves in a plane, at common times.

    Returns:
        ``step`` between frames [s] and ``count`` of them, ``parts`` of the robot, each name and
        number of lines, the ``view`` of the whole robot and the ``detail`` of the path as x, y,
        width, height [m], and the ``runs``. The numbers of a frame, packed, are x, y of the
        reference, of the end effector, and of both ends of each line, part by part; a run that is
        shorter stays at its end.
    """
    duration = max(float(run.log.time[-1]) for run in runs)
    count = min(MOST, int(duration * RATE) + 1)
    times = np.linspace(0.0, duration, count)
    parts: list[tuple[str, int]] = []
    all_frames = []
    for run in runs:
        robot = robot_of(run.log.config)
        rows = np.clip(np.searchsorted(run.log.time, times), 0, len(run.log.time) - 1)
        pose = run.poses.actual[rows]
        segments = robot.module.segments(robot.parameters, pose, run.log.position[rows])
        parts = [(part, ends.shape[1]) for part, ends in segments.items()]
        points = (run.poses.reference[rows, :2], pose[:, :2], *segments.values())
        all_frames.append(np.hstack([part.reshape(count, -1) for part in points]))
    together = np.concatenate(all_frames)
    return {
        'step': duration / max(count - 1, 1),
        'count': count,
        'parts': parts,
        'view': _box(together.reshape(-1, 2), 0.05),
        'detail': _box(together[:, :4].reshape(-1, 2), 0.12),
        'runs': [
            {'style': run.style, 'frames': packed(frames)}
            for run, frames in zip(runs, all_frames, strict=True)
        ],
    }


def _box(points: np.ndarray, margin: float) -> list[float]:
    """Square around points [m, m, m, m]: x, y of a corner, width, height."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float((high - low).max()) * (1.0 + 2.0 * margin), 1e-3)
    x, y = (low + high) / 2.0 - size / 2.0
    return [float(x), float(y), size, size]
