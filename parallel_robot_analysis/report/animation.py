"""The moving robot as plain data for the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_analysis.report.plots import packed
from parallel_robot_analysis.report.runs import Run
from parallel_robot_base import config
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_model.planar_3rrr.skeleton import skeleton

RATE = 50.0  # Hz, of the frames
MOST = 1500  # frames of a long run


def animation(runs: Sequence[Run]) -> dict[str, Any]:
    """Postures of all runs of a scenario at common times.

    Returns:
        ``step`` between frames [s] and ``count`` of them, ``base`` joints [m], the ``view`` of
        the whole robot and the ``detail`` of the path as x, y, width, height [m], and the
        ``runs``. The numbers of a frame, packed, are x, y of the reference, of the platform, of
        the elbows and of the joints of the platform; a run that is shorter stays at its end.
    """
    duration = max(float(run.log.time[-1]) for run in runs)
    count = min(MOST, int(duration * RATE) + 1)
    times = np.linspace(0.0, duration, count)
    base, all_frames = np.empty((0, 2)), []
    for run in runs:
        robot = config.group(run.log.config, RobotParameters, 'robot')
        rows = np.clip(np.searchsorted(run.log.time, times), 0, len(run.log.time) - 1)
        pose = run.poses.actual[rows]
        points = skeleton(robot, pose, run.log.position[rows])
        base = points.base
        flat = (run.poses.reference[rows, :2], pose[:, :2], points.elbow, points.platform)
        all_frames.append(np.hstack([part.reshape(count, -1) for part in flat]))
    together = np.concatenate(all_frames)
    return {
        'step': duration / max(count - 1, 1),
        'count': count,
        'base': base.tolist(),
        'view': _box(np.concatenate([base, together.reshape(-1, 2)]), 0.05),
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
