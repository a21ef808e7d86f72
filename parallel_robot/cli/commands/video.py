"""The command ``video``: the moving robot of a bag, or of several side by side."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.analysis import video_file
from parallel_robot.analysis.video import MOST
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot.cli.shared import add_bag_arguments, bag_view, robot_code
from parallel_robot_model.common.options import number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'bags', nargs='+', type=Path, metavar='BAG', help=f'side by side, up to {MOST}'
    )
    parser.add_argument(
        '--out', type=Path, required=True, metavar='FILE', help='.mp4 or .gif; must not exist'
    )
    parser.add_argument(
        '--rate',
        type=number,
        default=video_file.RATE,
        metavar='HZ',
        help='frames a second, default: 25',
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
    add_bag_arguments(parser)
    add_set_argument(parser)
    add_trust_argument(parser, 'the robot')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    values = given(arguments)
    made = video_file.make(
        arguments.bags,
        arguments.out,
        arguments.rate,
        arguments.speed,
        arguments.magnify,
        robot_code(arguments, values),
        bag_view(arguments, values),
    )
    print(f'video   {made.path}, {made.frames} frames, errors magnified {made.magnified:g} times')
    return 0
