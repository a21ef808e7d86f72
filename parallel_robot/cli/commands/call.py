"""The command ``call``: a service of a running node that takes no arguments."""

from __future__ import annotations

import argparse

from parallel_robot_model.common.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'service', metavar='NODE/SERVICE', help='such as controller/clear_fault, plant/reset'
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    name, slash, service = arguments.service.strip('/').rpartition('/')
    if not slash:
        raise InputError(f'call takes NODE/SERVICE, such as {arguments.service}/ready')
    from parallel_robot.cli.ros_session import remote  # only this command needs ROS

    with remote(name) as node:
        done, text = node.call(service)
    print(text if done else f'refused: {text}')
    return 0 if done else 1
