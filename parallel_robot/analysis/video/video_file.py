"""A video of bags, side by side: asked for, checked, written."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.analysis.video import files, film
from parallel_robot.analysis.video.scene import MOST, frame_times, magnification, scene
from parallel_robot.bags import output
from parallel_robot.bags.output import tracked
from parallel_robot.bags.reading.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.run.recorded_robot import NONE, RobotCode
from parallel_robot_model.common.errors import InputError

RATE = 25.0  # Hz, unless told
RATES = 1.0, 100.0  # Hz
SPEEDS = 0.001, 1000.0
MAGNIFICATIONS = 1.0, 1e9


class Video(NamedTuple):
    """A video that was written.

    Attributes:
        path: Its file.
        frames: Number of its frames.
        magnified: By how much errors of the path are magnified.
    """

    path: Path
    frames: int
    magnified: float


def make(
    bags: Sequence[Path],
    out: Path,
    rate: float = RATE,
    speed: float = 1.0,
    magnify: float | None = None,
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
) -> Video:
    """Write the video of some bags.

    Args:
        bags: Directories of the bags, or one file of each.
        out: Its file, .mp4 or .gif, which must not exist.
        rate: Frames of a second of the video [Hz].
        speed: Seconds of the motion in a second of the video.
        magnify: By how much errors of the path are magnified; None: as much as they fill the view.
        code: What may run to know their robots.
        view: What bags do not say themselves, and which part is wanted.

    Raises:
        InputError: a value is wrong, bags are too many or no bags, or the file cannot be written.
        RunError: the disk is full.
    """
    files.check_format(out.suffix)
    output.check_new(out, '--out')
    _check('--rate', rate, *RATES, 'Hz')
    _check('--speed', speed, *SPEEDS)
    if magnify is not None:
        _check('--magnify', magnify, *MAGNIFICATIONS)
    if len(bags) > MOST:
        raise InputError(f'a video takes up to {MOST} bags, not {len(bags)}')
    runs = list(itertools.chain(*read_runs(bags, code, view).values()))
    times = frame_times(runs, rate, speed, files.MOST[out.suffix])
    magnified = magnify or magnification(runs)
    scenes = [scene(run, times, magnified) for run in runs]
    frames = tracked(film.frames(scenes, times, magnified), len(times), 'frames')
    last = film.frames(scenes, times[-1:], magnified)
    with output.growing(out) as stream:
        files.encode(frames, out.suffix, rate, last, stream)
    return Video(out, len(times), magnified)


def _check(option: str, value: Any, least: float, most: float, unit: str = '') -> None:
    """Refuse a number that is out of its range.

    Raises:
        InputError: it is, or it is no number.
    """
    known = isinstance(value, Real) and math.isfinite(value)
    if not (known and least <= value <= most):
        span = f'{least:g} to {most:g} {unit}'.rstrip()
        given = f'{value:g}' if isinstance(value, Real) else repr(value)
        raise InputError(f'{option} must be {span}, not {given}')
