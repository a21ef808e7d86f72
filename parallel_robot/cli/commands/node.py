"""The command ``node``: one node alone, as ``ros2 run`` starts it."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from parallel_robot_model.common.errors import UnknownNameError
from parallel_robot_model.processes.node_processes import MODULES

NODES = {
    **MODULES,
    'player': 'parallel_robot.bags.player_node',
    'monitor': 'parallel_robot.analysis.monitor_node',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('name', metavar='NODE', help=', '.join(NODES))
    parser.add_argument(
        'arguments',
        nargs=argparse.REMAINDER,
        metavar='...',
        help='of the node, e.g. --ros-args -p law:=smc',
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.name not in NODES:
        raise UnknownNameError('node', arguments.name, NODES)
    sys.argv = [arguments.name, *arguments.arguments]
    return import_module(NODES[arguments.name]).main()
