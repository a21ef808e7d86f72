"""The command ``recover``: a whole bag of what is intact in a broken one."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from parallel_robot.bags.writing.recovery import recover
from parallel_robot.cli.shared import add_format_argument, show


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag, or one file of it')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='bag; must not exist; default: BAG_recovered'
    )
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    bag = Path(os.path.realpath(arguments.bag))  # in a loop of links too
    name = bag.name.removesuffix('.zstd').removesuffix('.mcap')
    out = arguments.out or bag.parent / f'{name}_recovered'
    found = recover(arguments.bag, out)
    show(arguments.format, found.parts(), found.as_data(), [f'bag     {out}'])
    return 0
