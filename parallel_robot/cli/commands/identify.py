"""The command ``identify``: inertia and friction of the robot from the motion in a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.bags.run import joint_table
from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import add_bag_arguments, add_format_argument, bag_view, show, warn
from parallel_robot.studies.estimate import check_files
from parallel_robot.studies.identification import bag_identification, design
from parallel_robot.studies.identification.design import SEED, TRIALS
from parallel_robot.studies.identification.regression_rows import CUTOFF
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'bag',
        type=Path,
        nargs='?',
        help='bag with a motion that excites, or a table of it, .csv or .parquet, with a '
        f'header as {joint_table.EXAMPLE}',
    )
    parser.add_argument(
        '--rest',
        action='store_true',
        help='only the noise of the sensors, e.g. of a robot whose drives are off',
    )
    parser.add_argument(
        '--validate',
        type=Path,
        metavar='BAG',
        help='another bag, whose torques are predicted, or FROM:TO [s], a part of this one',
    )
    parser.add_argument(
        '--hold-out',
        type=float,
        metavar='SHARE',
        help='share of the time, at the end, on which a fit to what is before it is judged, '
        'default a third; 0: none',
    )
    parser.add_argument(
        '--out', type=Path, metavar='FILE', help='write the robot as YAML, for --param-file'
    )
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='torques, measured and predicted: png, pdf, svg',
    )
    add_format_argument(parser)
    parser.add_argument(
        '--cutoff',
        type=float,
        metavar='HZ',
        help=f'bandwidth, default {CUTOFF:g}, or a tenth of the rate',
    )
    parser.add_argument(
        '--bounds',
        action='append',
        default=[],
        metavar='NAME=LOW:HIGH',
        help='what is known: mass [kg] of all, payload, m[LINK], x[LINK], y[LINK] or z[LINK], '
        "between which [m] a link's mass lies in its frame; may be repeated",
    )
    parser.add_argument(
        '--all',
        action='store_true',
        help='all parameters and their intervals',
    )
    parser.add_argument(
        '--torque-constant',
        type=_constants,
        metavar='A,B,C',
        help='of a table with currents, i1 [A] ..., in place of torques: one for all joints, or '
        f'one for each [N m/A], the gear ratio in it; {joint_table.AUTO}: to be found',
    )
    parser.add_argument(
        '--design',
        metavar='SCENARIO',
        help='no bag: search for the coefficients of its exciting trajectory, write them to --out',
    )
    parser.add_argument('--trials', type=int, metavar='N', help=f'of --design, default {TRIALS}')
    parser.add_argument('--seed', type=int, help=f'of --design, default {SEED}')
    simulate.add_set_argument(parser)
    add_bag_arguments(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    check_files(arguments.out, arguments.figure)
    others = {
        'set': arguments.assignments,
        'param-file': arguments.param_files,
        'topic': arguments.topics,
        'hold-out': arguments.hold_out,
        'torque-constant': arguments.torque_constant,
        'from': arguments.start,
        'to': arguments.stop,
    }
    bag_identification.check_options(vars(arguments) | others)
    if arguments.design is not None:
        return _design(arguments)
    bag = arguments.bag
    view = bag_view(arguments, simulate.given(arguments))
    view = view._replace(torque_constant=arguments.torque_constant or ())
    if arguments.rest:
        still = bag_identification.at_rest(bag, view)
        show(arguments.format, still.parts(), {'rest': still.as_data()})
        return 0
    bounds = bag_identification.bounds_of(arguments.bounds)
    share = arguments.hold_out
    share = bag_identification.HOLD_OUT if share is None else share
    found = bag_identification.identify(
        bag, arguments.validate, arguments.cutoff, view, bounds, share
    )
    warn(found.warnings)
    found.write(arguments.out, arguments.figure)
    files = {'robot': arguments.out, 'figure': arguments.figure}
    written = [f'{name:<7} {path}' for name, path in files.items() if path]
    parts = found.all_parts() if arguments.all else found.parts()
    show(arguments.format, parts, found.as_data(), written)
    return 0


def _constants(text: str) -> tuple[float | None, ...]:
    """Numbers, or AUTO, with commas between them."""
    return tuple(None if each == joint_table.AUTO else number(each) for each in text.split(','))


def _design(arguments: argparse.Namespace) -> int:
    """Search for an exciting trajectory and write its parameters."""
    if arguments.out is None:
        raise InputError('--design needs --out FILE for the coefficients')
    changes = simulate.given(arguments)
    found = design.search(arguments.design, changes, arguments.trials, arguments.seed)
    found.write(arguments.out)
    show(
        arguments.format, found.parts(), found.as_data(), [f'{"coefficients":<13}{arguments.out}']
    )
    return 0
