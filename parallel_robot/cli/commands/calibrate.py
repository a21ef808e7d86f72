"""The command ``calibrate``: geometry and zero angles of the robot from measured poses."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import (
    add_bag_arguments,
    add_format_argument,
    bag_view,
    robot_code,
    show,
    warn,
)
from parallel_robot.studies.calibration import bag_calibration, design
from parallel_robot.studies.calibration.tracker import FREE
from parallel_robot.studies.estimate import check_files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, nargs='?', help='bag with the joint states')
    parser.add_argument(
        '--poses',
        type=Path,
        metavar='FILE',
        help='CSV of measured poses: t [s] or stamp [ns], coordinates of the pose; default: a '
        'topic of the bag',
    )
    parser.add_argument(
        '--pose-topic', metavar='TOPIC', help='topic of the bag with measured poses'
    )
    parser.add_argument(
        '--free',
        action='append',
        default=[],
        choices=FREE,
        help='frame: where the tracker stands is unknown; target: where its target sits on the '
        'platform; may be repeated',
    )
    parser.add_argument(
        '--robust',
        action='store_true',
        help='leave out poses that are not what the others tell: a tracker that lost its target, '
        'swapped rows; default: they are named',
    )
    parser.add_argument(
        '--out', type=Path, metavar='FILE', help='write the robot as YAML, for --param-file'
    )
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='errors of the poses before and after, and the changes: png, pdf, svg',
    )
    add_format_argument(parser)
    parser.add_argument(
        '--scenario',
        help='with --design, no bag: the robot and the first pose; else what a bag without a '
        'configuration is of, default: paper_circle',
    )
    parser.add_argument(
        '--design',
        type=int,
        metavar='N',
        help='no bag: choose so many poses that tell most; --out has the motion through them',
    )
    parser.add_argument('--seed', type=int, help='of --design, default 0')
    add_trust_argument(parser, 'the robot')
    simulate.add_set_argument(parser)
    add_bag_arguments(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    check_files(arguments.out, arguments.figure)
    others = {
        'pose-topic': arguments.pose_topic,
        'topic': arguments.topics,
        'from': arguments.start,
        'to': arguments.stop,
    }
    bag_calibration.check_options(vars(arguments) | others)
    if arguments.bag is None:
        return _design(arguments)
    values = simulate.given(arguments)
    found = bag_calibration.calibrate(
        arguments.bag,
        arguments.poses,
        arguments.pose_topic,
        arguments.free,
        robot_code(arguments, values),
        bag_view(arguments, values),
        arguments.robust,
    )
    warn(found.warnings)
    found.write(arguments.out, arguments.figure)
    written = {'robot': arguments.out, 'figure': arguments.figure}
    files = [f'{name:8}{path}' for name, path in written.items() if path]
    show(arguments.format, found.parts(), found.as_data(), files)
    return 0


def _design(arguments: argparse.Namespace) -> int:
    """Choose poses that tell most, and write a motion through them."""
    found = design.design(
        arguments.scenario,
        simulate.given(arguments),
        arguments.design,
        arguments.free,
        arguments.seed or 0,
    )
    found.write(arguments.out)
    files = [f'motion  {arguments.out}'] if arguments.out else []
    show(arguments.format, found.parts(), found.as_data(), files)
    return 0
