"""The command ``param``: parameters of a running node."""

from __future__ import annotations

import argparse

import yaml

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.yaml_file import MARK

ACTIONS = ('get', 'set', 'dump')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('action', choices=ACTIONS, help='get, set, or dump: all as a file')
    parser.add_argument('node', metavar='NODE', help='such as controller, or left/controller')
    parser.add_argument(
        'words', nargs='*', metavar='WORD', help='get: KEY, several; set: KEY=VALUE, all or none'
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    action, words = arguments.action, arguments.words
    if (action == 'dump') == bool(words):
        what = {'get': 'KEY', 'set': 'KEY=VALUE', 'dump': 'no more words'}[action]
        raise InputError(f'{action} NODE takes {what}' + (f', not {words[0]!r}' if words else ''))
    changes = yaml_file.parse_assignments(words, action) if action == 'set' else {}
    from parallel_robot.cli.ros_session import remote  # only this command needs ROS

    with remote(arguments.node) as node:
        if action == 'set':
            node.set(changes)
        elif action == 'get':
            for key, value in node.values(words).items():
                print(f'{key}: {yaml_file.text_of(value)}')
        else:
            values = {node.name: {MARK: node.values(node.names())}}
            print(yaml.dump(values, Dumper=yaml_file.Dumper, default_flow_style=None), end='')
    return 0
