"""The part of a run that figures are of, on a command line."""

from __future__ import annotations

import argparse
import math

from parallel_robot_model.common.options import number

OF_FIGURES = (
    'time of the part that all figures are of, default: errors are those of the second half of '
    'the motion'
)


def add_window_arguments(parser: argparse.ArgumentParser, text: str = OF_FIGURES) -> None:
    """Declare ``--from`` and ``--to``; `text` says what they choose."""
    for name, dest, end in (('--from', 'start', 'first'), ('--to', 'stop', 'last')):
        parser.add_argument(
            name,
            dest=dest,
            type=_time,
            metavar='S',
            help=f'{end} {text}',
        )


def _time(text: str) -> float:
    """A time [s].

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    found = number(text)
    if not math.isfinite(found):
        raise argparse.ArgumentTypeError(f'a time in s is wanted, not {text!r}')
    return found
