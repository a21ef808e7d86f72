"""The command ``report``: the paper's figures and one interactive page, of one bag or several."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.analysis.pictures import RUNS
from parallel_robot.analysis.report import report_files
from parallel_robot.analysis.report.looks import add_scale_argument
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot.cli.shared import add_bag_arguments, bag_view, robot_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'bags', nargs='+', type=Path, metavar='BAG', help=f'bags to compare, up to {len(RUNS)}'
    )
    parser.add_argument(
        '--out', type=Path, required=True, metavar='DIR', help='of the report; must not exist'
    )
    add_scale_argument(parser)
    add_bag_arguments(parser)
    add_set_argument(parser)
    add_trust_argument(parser, 'the robot')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    values = given(arguments)
    code, view = robot_code(arguments, values), bag_view(arguments, values)
    made = report_files.make(arguments.bags, arguments.out, arguments.scale, code, view)
    for warning in made.warnings:
        print(warning)
    print(f'page     {made.page}\nfigures  {made.figures} files in {arguments.out}')
    return 0
