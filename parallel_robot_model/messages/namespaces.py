"""The namespace of a robot's nodes and topics, by which several robots share a ROS domain."""

from __future__ import annotations

import argparse
import re

from parallel_robot_model.common.errors import InputError

MAX_LENGTH = 100  # characters; the middleware has 247 for a whole name
NAMESPACE = re.compile(r'(?!.*__)(/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*|/?)', re.ASCII)


def add_namespace_argument(
    parser: argparse.ArgumentParser, text: str, default: str | None = ''
) -> None:
    """Declare ``--namespace``."""
    parser.add_argument('--namespace', default=default, metavar='NAME', help=text)


def full(name: str) -> str:
    """Full name of a namespace, e.g. ``/left``; empty for none.

    Raises:
        InputError: ROS does not allow the name.
    """
    if not NAMESPACE.fullmatch(name) or len(name) > MAX_LENGTH:
        raise InputError(
            'namespace must be words of letters, digits and single underscores joined by /, none '
            f'beginning with a digit, at most {MAX_LENGTH} characters, e.g. left, not {name!r}'
        )
    name = name.strip('/')
    return f'/{name}' if name else ''
