"""Frames as a file: MP4 by PyAV, GIF by Pillow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import IO

import numpy as np

from parallel_robot_model.common.errors import UnknownNameError, optional

COLOURS = 48  # of all frames of a GIF
MOST = {'.mp4': 50_000, '.gif': 1500}  # frames; those of a GIF are held in memory
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
