"""How a bag is to be read, on a command line: the same options for all commands that read one."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from parallel_robot.bags.reading.bag_view import NAMES, BagView, view
from parallel_robot.cli.window import add_window_arguments
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.messages.topics import add_namespace_argument, full

NOT_IN_FOREIGN = 'none in a bag of somebody else; --figure FILE draws one'


def add_bag_arguments(parser: argparse.ArgumentParser, window: bool = True) -> None:
    """Declare what a bag does not say itself, beside ``--param-file`` and ``--set``.

    Args:
        parser: Of the command.
        window: Whether ``--from`` and ``--to`` are declared, too, and choose what is read.
    """
    parser.add_argument(
        '--topic',
        action='append',
        default=[],
        dest='topics',
        metavar='NAME=TOPIC',
        help='topic of the bag in place of one of the suite, e.g. '
        'joint_states=/robot1/joint_states, reference=..., commands=...; may be repeated',
    )
    if not any(action.dest == 'namespace' for action in parser._actions):
        add_namespace_argument(parser, 'of the robot, in a bag of several', None)
    parser.add_argument(
        '--joints',
        metavar='A,B,C',
        help='names of the joints in the bag, in the order of those of the robot',
    )
    if not any(action.dest == 'scenario' for action in parser._actions):
        parser.add_argument(
            '--scenario',
            help='what a bag without a configuration is of, default: paper_circle',
        )
    parser.add_argument(
        '--override',
        action='store_true',
        help='--scenario, --joints, --param-file and --set take the place of what a bag says',
    )
    if window:
        add_window_arguments(parser, 'time of the part that is read, default: all')


def bag_view(
    arguments: argparse.Namespace, values: Mapping[str, Any], whole: bool = False
) -> BagView:
    """How a bag is to be read, by the arguments.

    Args:
        arguments: Of the command.
        values: Keys of the configuration, of ``--param-file`` and ``--set``.
        whole: Whether all is read, whatever ``--from`` and ``--to`` say.

    Raises:
        InputError: one of them is wrong.
    """
    joints = (arguments.joints or '').split(',')
    return view(
        topics_of(arguments.topics),
        None if arguments.namespace is None else full(arguments.namespace),
        [name.strip() for name in joints if name.strip()],
        arguments.scenario,
        values,
        arguments.override,
        (arguments.start, arguments.stop),
    )._replace(whole=whole)


def topics_of(words: list[str]) -> dict[str, str]:
    """Topics by name, of words NAME=TOPIC.

    Raises:
        InputError: a word is none.
    """
    found = {}
    for word in words:
        name, equals, topic = word.partition('=')
        if not equals:
            names = ', '.join(list(NAMES)[:3])
            raise InputError(f'--topic takes NAME=TOPIC, with a name as {names}, not {word!r}')
        found[name.strip()] = topic.strip()
    return found
