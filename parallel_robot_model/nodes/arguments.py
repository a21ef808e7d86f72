"""The command line of a node: ROS arguments, arguments of its own, help."""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.utilities import remove_ros_args

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import Parser
from parallel_robot_model.configuration.config import PACKAGE

AddArguments = Callable[[argparse.ArgumentParser], None]


def read(
    node: Callable[..., Any], words: Sequence[str], add_arguments: AddArguments | None = None
) -> dict[str, Any]:
    """Read the command line of a node; ``--help`` is answered, and ends the process.

    Args:
        node: Class of the node. Its help shows the docstring of its module and, as an example,
            its `example` after its name.
        words: The command line, with the name of the program.
        add_arguments: Declares arguments of the node's own; None: it has none.

    Returns:
        Name to value of the node's own arguments.

    Raises:
        InputError: an argument is unknown, or its value is wrong.
    """
    name = node.__name__.removesuffix('Node').lower()
    about = inspect.cleandoc(sys.modules[node.__module__].__doc__ or '')
    parser = Parser(
        prog=name,
        usage=None if add_arguments else '%(prog)s [-h] [--ros-args ...]',
        description=about,
        epilog=(
            'Parameters follow --ros-args; docs/parameters.md lists them with units and ranges,\n'
            f'"ros2 param describe /{name} KEY" describes them while the node runs. Example:\n\n'
            f'  ros2 run {PACKAGE} {name} {getattr(node, "example", "")}\n\n'
            f'Command line (run, analyze, ...): {PACKAGE}, else ros2 run {PACKAGE} {PACKAGE}'
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if add_arguments is not None:
        add_arguments(parser)
    try:
        own = remove_ros_args(list(words))
    except RuntimeError as error:  # base of all that rcl says of its arguments
        text = str(error).splitlines()[0]
        raise InputError(f'unknown ROS arguments {text}' if text[0] == '[' else text) from None
    return vars(parser.parse_args(own[1:]))
