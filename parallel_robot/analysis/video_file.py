"""A video of bags, side by side: asked for, checked, written."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from fractions import Fraction
from numbers import Real
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.analysis.video import MOST, frame_times, frames, magnification, scene
from parallel_robot.bags import output
from parallel_robot.bags.bag_reader import view
from parallel_robot.bags.output import tracked
from parallel_robot.bags.run.recorded_robot import code_of
from parallel_robot_model.common.errors import InputError, UnknownNameError, optional
from parallel_robot_model.common.options import path, paths
from parallel_robot_model.configuration.config import Place, Places

# Frames as a file: MP4 by PyAV, GIF by Pillow.

COLOURS = 48  # of all frames of a GIF
MOST_FRAMES = {'.mp4': 50_000, '.gif': 1500}  # frames; those of a GIF are held in memory
QUALITY = {'crf': '20', 'preset': 'medium'}  # of H.264
Frames = Iterable[np.ndarray]


def encode(frames: Frames, suffix: str, rate: float, full: Frames, stream: IO[bytes]) -> None:
    """Write a video.

    Args:
        frames: Each of type uint8, shape (height, width, 3), both even.
        suffix: One of FORMATS.
        rate: Frames a second [Hz].
        full: One frame that has all their colours.
        stream: Its file.

    Raises:
        UnknownNameError: no such format.
        InputError: PyAV is needed and not installed.
    """
    check_format(suffix)
    FORMATS[suffix](frames, rate, stream, full)


def check_format(suffix: str) -> None:
    """Refuse a suffix that is of no format of a video, or whose library is not installed.

    Raises:
        UnknownNameError: with the formats.
        InputError: PyAV is needed and not installed.
    """
    if suffix not in FORMATS:
        raise UnknownNameError('video format', suffix, FORMATS)
    if suffix == '.mp4':
        optional('av')


def _mp4(frames: Frames, rate: float, content: IO[bytes], _: Frames) -> None:
    av = optional('av')
    with av.open(content, 'w', format='mp4') as container:
        stream = container.add_stream('libx264', rate=Fraction(rate).limit_denominator(1000))
        stream.pix_fmt = 'yuv420p'  # which every player shows
        stream.options = QUALITY
        for k, frame in enumerate(frames):
            if k == 0:
                stream.height, stream.width, _ = frame.shape
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format='rgb24')
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def _gif(frames: Frames, rate: float, content: IO[bytes], full: Frames) -> None:
    from PIL import Image  # slow to import

    (last,) = map(Image.fromarray, full)
    palette = last.quantize(COLOURS, Image.Quantize.FASTOCTREE)  # keeps white, and thin curves
    pictures = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    )
    first = next(pictures)
    first.save(content, 'GIF', save_all=True, append_images=pictures, duration=1e3 / rate, loop=0)


FORMATS: dict[str, Callable[[Frames, float, IO[bytes], Frames], None]] = {
    '.mp4': _mp4,
    '.gif': _gif,
}


RATE = 25.0  # Hz, unless told
RATES = 1.0, 100.0  # Hz
SPEEDS = 0.001, 1000.0
MAGNIFICATIONS = 1.0, 1e9


class Video(NamedTuple):
    """A video that was written."""

    path: Path  # its file
    frames: int  # number of its frames
    magnified: float  # by how much errors of the path are magnified

    def __str__(self) -> str:
        """What the command prints."""
        frames = f'{self.frames} frames, errors magnified {self.magnified:g} times'
        return f'video   {self.path}, {frames}\n'


def video(
    bags: Places,
    out: Place,
    *,
    rate: float = RATE,
    speed: float = 1.0,
    magnify: float | None = None,
    trust: bool = False,
    **options: Any,
) -> Video:
    """Write a video of the moving robot, as ``parallel_robot video`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/video_of')
    >>> pr.video('runs/video_of', 'runs/smc.gif', rate=4).frames
    3

    Args:
        bags: A bag, or up to 4, side by side.
        out: Its file, .mp4 or .gif, which must not exist.
        rate: Frames of a second of the video [Hz]; default: 25.
        speed: Times real time, e.g. 0.1 for slow motion; default: 1.
        magnify: By how much errors of the path are magnified, the same for all bags; default: as
            much as they fill the view.
        trust: Whether the code of the robots that bags hold runs, with all your rights; on a
            terminal, it is shown first.
        options: What bags do not say themselves, see ``load``, and keys of their configuration,
            such as `custom_robots`, files that take the place of those in bags.

    Returns:
        Its path, the number of its frames, and by how much errors are magnified.

    Raises:
        InputError: a value is wrong, bags are too many or no bags, or the file cannot be written.
        RunError: the disk is full.
    """
    found, place, asked = paths('a bag', bags), path('out', out), view(**options)
    code = code_of(trust, asked)
    check_format(place.suffix)
    output.check_new(place, '--out')
    _check('--rate', rate, *RATES, 'Hz')
    _check('--speed', speed, *SPEEDS)
    if magnify is not None:
        _check('--magnify', magnify, *MAGNIFICATIONS)
    if len(found) > MOST:
        raise InputError(f'a video takes up to {MOST} bags, not {len(found)}')
    runs = list(itertools.chain(*read_runs(found, code, asked).values()))
    times = frame_times(runs, rate, speed, MOST_FRAMES[place.suffix])
    magnified = magnify or magnification(runs)
    scenes = [scene(run, times, magnified) for run in runs]
    pictures = tracked(frames(scenes, times, magnified), len(times), 'frames')
    last = frames(scenes, times[-1:], magnified)
    with output.growing(place) as stream:
        encode(pictures, place.suffix, rate, last, stream)
    return Video(place, len(times), magnified)


def _check(option: str, value: Any, least: float, most: float, unit: str = '') -> None:
    """Refuse a number that is out of its range."""
    known = isinstance(value, Real) and math.isfinite(value)
    if not (known and least <= value <= most):
        span = f'{least:g} to {most:g} {unit}'.rstrip()
        given = f'{value:g}' if isinstance(value, Real) else repr(value)
        raise InputError(f'{option} must be {span}, not {given}')
