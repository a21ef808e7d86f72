"""The command ``limit``: the least error of any controller, in a scenario or in a study."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.analysis.pictures import check_new
from parallel_robot.bags import output
from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import add_format_argument, show, tell, warn
from parallel_robot.studies import least_errors
from parallel_robot.studies.calm import REST
from parallel_robot.studies.least_errors import is_study


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'scenario', metavar='SCENARIO|STUDY', help='a name or a file; of a study, all its robots'
    )
    parser.add_argument(
        '--runs', type=int, metavar='N', help="robots of each scenario, default: the study's"
    )
    parser.add_argument('--duration', type=float, metavar='S', help='length of the motion [s]')
    parser.add_argument(
        '--out', type=Path, metavar='FILE', help='write one row for each robot, as CSV'
    )
    parser.add_argument(
        '--calm', action='store_true', help='also the least error with at most some chattering'
    )
    parser.add_argument(
        '--rest',
        type=float,
        default=REST,
        metavar='W',
        help='weight of joints that the error does not see, as a rotation, when calm has its '
        'price; 1: as of the place (default: %(default)g)',
    )
    parser.add_argument(
        '--figure', type=Path, metavar='FILE', help='picture of that; png, pdf, svg'
    )
    add_format_argument(parser)
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.out:
        output.check_new(arguments.out, '--out')
    if arguments.figure:
        check_new(arguments.figure)
    name, calm = arguments.scenario, arguments.calm or arguments.figure is not None
    changes = (simulate.given if is_study(name) else simulate.overrides)(arguments)
    found = least_errors.compute(
        name, changes, arguments.runs, arguments.duration, calm, arguments.rest
    )
    warn(found.warnings)
    head, rows = found.rows()
    show(arguments.format, found.parts(), [dict(zip(head, row, strict=True)) for row in rows])
    if arguments.out:
        output.save(arguments.out, found.csv().encode())
        tell(arguments.format, f'rows    {arguments.out}')
    if arguments.figure:
        found.save_figure(arguments.figure)
        tell(arguments.format, f'figure  {arguments.figure}')
    return 0
