"""The command ``export``: a bag as a table, one row for each state, or as a bag for viewers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from parallel_robot.analysis import table, table_file, viewer_copy
from parallel_robot.bags import recorded_robot
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.bag_options import add_bag_arguments, bag_view
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot.cli.robot_code import robot_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag, or one file of it')
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        '--out',
        type=Path,
        metavar='FILE',
        help='table; must not exist; its suffix chooses: .csv or .parquet',
    )
    kind.add_argument(
        '--foxglove',
        type=Path,
        metavar='DIR',
        help='copy of the bag, with description, frames (tf) and paths of the robot for Foxglove, '
        'Lichtblick and RViz; must not exist',
    )
    add_bag_arguments(parser)
    add_set_argument(parser)
    add_trust_argument(parser, 'the robot')
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    bag, out, memory = arguments.bag, arguments.out, arguments.max_memory
    if out:
        table_file.check(out)
    values = given(arguments)
    code, view = robot_code(arguments, values), bag_view(arguments, values)
    only = arguments.foxglove is None
    recording = recorded_robot.read(bag, memory, code, table.NEEDED, view, motion_only=only)
    if arguments.foxglove:
        copy = viewer_copy.write(bag, recording, arguments.foxglove, memory)
        _warn(copy.warnings)
        seen = ', seen' if copy.seen else ''
        print(f'bag     {copy.path}, with {copy.frames} frames of the robot{seen}')
        return 0
    columns, warnings = table.of(recording)
    _warn(warnings)
    table_file.write(out, columns)
    print(f'table   {out}, {len(columns["time_s"])} rows, {len(columns)} columns')
    return 0


def _warn(warnings: Iterable[str]) -> None:
    for warning in warnings:
        print(f'warning: {warning}', file=sys.stderr)
