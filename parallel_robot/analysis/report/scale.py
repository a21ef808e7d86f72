"""Whether errors are drawn with their sign, or as magnitudes on a logarithmic axis."""

from __future__ import annotations

import argparse
from collections.abc import Iterable

import numpy as np

from parallel_robot_model.common.errors import UnknownNameError

AUTO, LINEAR, LOG = SCALES = ('auto', 'linear', 'log')
FLAT = 1 / 30  # of the largest value: a curve that is mostly below it looks like zero


def logarithmic(scale: str, curves: Iterable[np.ndarray]) -> bool:
    """Decide on the axis of errors that are drawn together.

    Args:
        scale: One of SCALES; AUTO: logarithmic if on a linear axis a curve would look like zero.
        curves: Their values, in one unit; each shape (N,) with N > 0.

    Raises:
        UnknownNameError: there is no such scale.
    """
    check(scale)
    if scale != AUTO:
        return scale == LOG
    sizes = [np.abs(curve) for curve in curves]
    typical = [float(np.median(size)) for size in sizes if size.any()]
    return bool(typical) and min(typical) < FLAT * max(float(size.max()) for size in sizes)


def check(scale: str) -> None:
    """Refuse what is no scale.

    Raises:
        UnknownNameError: there is no such scale.
    """
    if scale not in SCALES:
        raise UnknownNameError('scale', str(scale), SCALES)


def add_scale_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the argument ``--scale``."""
    parser.add_argument(
        '--scale',
        choices=SCALES,
        default=AUTO,
        help='of errors; log: their magnitude; auto (default): log where the spread asks for it',
    )
