"""The moving robot as numbers, and as plain data for the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis.report.plots import packed
from parallel_robot.analysis.report.runs import Run
from parallel_robot_model.robots.registry import robot_of

RATE = 50.0  # Hz, of the frames
MOST = 1500  # frames of a long run


class Postures(NamedTuple):
    """A robot whose pose is a place, in all runs at common times.

    Attributes:
        place: Number of the coordinates of a place: 2 in a plane, 3 in space.
        time: Times of the frames [s], shape (F,).
        parts: Parts of the robot, each name and number of lines.
        frames: For each run the numbers of its frames [m], shape (F, K): the places of the
            reference, of the end effector, and of both ends of each line, part by part. A run
            that is shorter stays at its end.
    """

    place: int
    time: np.ndarray
    parts: list[tuple[str, int]]
    frames: list[np.ndarray]


def postures(runs: Sequence[Run], rate: float = RATE) -> Postures:
    """Postures of all runs of a robot whose pose is a place, at most MOST.

    Args:
        runs: The runs.
        rate: Of the frames [Hz].
    """
    duration = max(float(run.motion.time[-1]) for run in runs)
    count = min(MOST, int(duration * rate) + 1)
    times = np.linspace(0.0, duration, count)
    place = runs[0].motion.poses.place
    parts: list[tuple[str, int]] = []
    all_frames = []
    for run in runs:
        robot = robot_of(run.log.config)
        motion = run.at(times)
        pose = motion.poses.actual
        segments = robot.module.segments(robot.parameters, pose, motion.position)
        parts = [(part, ends.shape[1]) for part, ends in segments.items()]
        points = (motion.poses.reference[:, :place], pose[:, :place], *segments.values())
        all_frames.append(np.hstack([part.reshape(count, -1) for part in points]))
    return Postures(place, times, parts, all_frames)


def animation(runs: Sequence[Run]) -> dict[str, Any]:
    """Postures of all runs of a robot whose pose is a place, for the page.

    Returns:
        ``place``, ``step`` between frames [s] and ``count`` of them, ``parts`` of the robot, the
        ``view`` of the whole robot and the ``detail`` of the path as x, y, width, height [m], in
        space as x, y, z, radius of a ball [m], and the ``runs``, whose frames are packed; see
        :class:`Postures`.
    """
    place, times, parts, all_frames = postures(runs)
    together = np.concatenate(all_frames)
    around = box if place == len('xy') else ball
    return {
        'place': place,
        'step': float(times[-1]) / max(len(times) - 1, 1),
        'count': len(times),
        'parts': parts,
        'view': around(together.reshape(-1, place), 0.05),
        'detail': around(together[:, : 2 * place].reshape(-1, place), 0.12),
        'runs': [
            {'style': run.style, 'frames': packed(frames)}
            for run, frames in zip(runs, all_frames, strict=True)
        ],
    }


def box(points: np.ndarray, margin: float) -> list[float]:
    """Square around points [m, m, m, m]: x, y of a corner, width, height."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = max(float((high - low).max()) * (1.0 + 2.0 * margin), 1e-3)
    x, y = (low + high) / 2.0 - size / 2.0
    return [float(x), float(y), size, size]


def ball(points: np.ndarray, margin: float) -> list[float]:
    """Ball around points in space [m, m, m, m]: x, y, z of its centre, radius."""
    centre = (np.nanmin(points, axis=0) + np.nanmax(points, axis=0)) / 2.0
    radius = float(np.nanmax(np.linalg.norm(points - centre, axis=1)))
    return [*map(float, centre), max(radius * (1.0 + margin), 5e-4)]
