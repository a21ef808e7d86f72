"""The code of the robot of a bag, on a command line."""

from __future__ import annotations

import argparse

from parallel_robot.bags.recorded_robot import KEY, RobotCode
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import assignments, modules


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what lets the robot of a bag be known: ``--trust`` and ``--set custom_robots``."""
    add_trust_argument(parser, 'the robot')
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        dest='assignments',
        metavar=f'{KEY}=[FILE]',
        help='file of the robot of the bag, where it is not of the suite',
    )


def robot_code(arguments: argparse.Namespace) -> RobotCode:
    """What may run, by the arguments.

    Raises:
        InputError: ``--set`` is of another key, or of no list of files.
    """
    given = assignments.parse(arguments.assignments)
    for key in given:
        if key != KEY:
            raise InputError(f'--set {key}: what a bag holds is not changed, only {KEY} is taken')
    files = modules.absolute(KEY, given.get(KEY, []))
    return RobotCode(arguments.trust, tuple(files))
