"""The command ``fronts``: the fronts of several tunings in one picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.cli.shared import add_format_argument, show
from parallel_robot.studies.tuning import front


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
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    found = front.compare(arguments.directories, arguments.out, '--out')
    show(arguments.format, found.parts(), found.as_data(), [f'fronts  {arguments.out}'])
    return 0
