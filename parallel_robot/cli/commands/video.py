"""The command ``video``: the moving robot of a bag, or of several side by side."""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path

from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.analysis.video import files, film
from parallel_robot.analysis.video.scene import MOST, frame_times, magnification, scene
from parallel_robot.bags import new_files
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.bags.progress import tracked
from parallel_robot.cli.robot_code import add_robot_arguments, robot_code
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import number

RATES = 1.0, 100.0  # Hz
SPEEDS = 0.001, 1000.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'bags', nargs='+', type=Path, metavar='BAG', help=f'side by side, up to {MOST}'
    )
    parser.add_argument(
        '--out', type=Path, required=True, metavar='FILE', help='.mp4 or .gif; must not exist'
    )
    parser.add_argument(
        '--rate', type=number, default=25.0, metavar='HZ', help='frames a second, default: 25'
    )
    parser.add_argument(
        '--speed',
        type=number,
        default=1.0,
        metavar='X',
        help='times real time, e.g. 0.1 for slow motion; default: 1',
    )
    parser.add_argument(
        '--magnify',
        type=number,
        metavar='X',
        help='errors of the path, the same for all bags; default: as much as they fill the view',
    )
    add_robot_arguments(parser)
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    out: Path = arguments.out
    files.check_format(out.suffix)
    new_files.check(out, '--out')
    _check('--rate', arguments.rate, *RATES, 'Hz')
    _check('--speed', arguments.speed, *SPEEDS)
    if arguments.magnify is not None:
        _check('--magnify', arguments.magnify, 1.0, 1e9)
    if len(arguments.bags) > MOST:
        raise InputError(f'a video takes up to {MOST} bags, not {len(arguments.bags)}')
    groups = read_runs(arguments.bags, arguments.max_memory, robot_code(arguments))
    runs = list(itertools.chain(*groups.values()))
    times = frame_times(runs, arguments.rate, arguments.speed, files.MOST[out.suffix])
    magnified = arguments.magnify or magnification(runs)
    scenes = [scene(run, times, magnified) for run in runs]
    frames = tracked(film.frames(scenes, times, magnified), len(times), 'frames')
    last = film.frames(scenes, times[-1:], magnified)
    content = files.encode(frames, out.suffix, arguments.rate, last)
    new_files.save(out, content.getbuffer())
    print(f'video   {out}, {len(times)} frames, errors magnified {magnified:g} times')
    return 0


def _check(option: str, value: float, least: float, most: float, unit: str = '') -> None:
    """Refuse a number that is out of its range.

    Raises:
        InputError: it is.
    """
    if not (math.isfinite(value) and least <= value <= most):
        span = f'{least:g} to {most:g} {unit}'.rstrip()
        raise InputError(f'{option} must be {span}, not {value:g}')
