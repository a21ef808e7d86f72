"""The command ``fronts``: the fronts of several tunings in one picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.cli.shared import add_format_argument, show
from parallel_robot.studies.tuning import front
from parallel_robot.studies.tuning.held_out import compare


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'directories', type=Path, nargs='+', metavar='DIR', help='--out of a `tune` that has ended'
    )
    parser.add_argument(
        '--out',
        type=Path,
        required=True,
        metavar='FILE',
        help=f'picture, {" or ".join(front.FORMATS)}; must not exist',
    )
    parser.add_argument(
        '--effort',
        metavar='MEASURE=VALUE',
        help='compare laws at exactly this effort, on the lines between the trials that enclose '
        'it; searches of a law with several seeds are one row',
    )
    parser.add_argument(
        '--study',
        metavar='STUDY',
        help='write --out, a .yaml, as this study with the trials around --effort as its laws',
    )
    parser.add_argument(
        '--sweep',
        type=Path,
        metavar='DIR',
        help='--out of a `sweep` of that study: its medians take the place of those of the search',
    )
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    found = compare(
        arguments.directories,
        arguments.out,
        arguments.effort,
        arguments.study,
        arguments.sweep,
        '--out',
    )
    files = [f'{"fronts" if arguments.study is None else "study"}  {arguments.out}']
    show(arguments.format, found.parts(), found.as_data(), files)
    return 0
