"""The transport of the middleware, which is chosen before rclpy starts.

A process that joins makes Fast DDS check shared memory, and now and then a node stands still for
0.33 s meanwhile (Fast-DDS 6535). Nodes that offer UDP alone are spared, whatever joins.
"""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy._rclpy_pybind11 import RCLError
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.plain_data import LOADER
from parallel_robot_model.processes.realtime import DISCOVERY_RANGE, LOCALHOST_ONLY

KEY = 'middleware'
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
USER_VARIABLES = (  # with which users set up Fast DDS
    PROFILES,
    TRANSPORTS,
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_ENVIRONMENT_FILE',
    'RMW_FASTRTPS_USE_QOS_FROM_XML',
    'ROS_DISCOVERY_SERVER',
    'ROS_STATIC_PEERS',
)
LOG_VARIABLES = ('ROS_LOG_DIR', 'ROS_HOME', 'HOME')  # in this order
HINTS = {  # by a part of what the middleware says
    'log': '; ROS_LOG_DIR names a directory for its log, which you can write',
    'peer': '; ROS_STATIC_PEERS names hosts that are known here',
}
USER_PROFILES = 'DEFAULT_FASTRTPS_PROFILES.xml'  # Fast DDS reads it in the current directory


def requested_middleware(arguments: Sequence[str]) -> str:
    """Value of the parameter ``middleware`` on a command line, else its default.

    The node's parameters are not known yet: rclpy reads them after it has made its participant.
    A value in a parameter file counts for whichever node it stands.
    """
    transport = config.default(KEY)
    for option, word in itertools.pairwise(arguments):
        if option in ('-p', '--param'):
            key, _, value = word.partition(':=')
            if key.rpartition(':')[2] == KEY:  # NODE:KEY or KEY
                transport = value.strip('\'"')
        elif option == '--params-file':
            transport = _in_file(Path(word)) or transport
    return str(transport)


def check_middleware(value: str, expected: str) -> None:
    """Refuse a value of ``middleware`` that was not seen when the transport was chosen.

    Raises:
        InputError: a scenario sets it, or a parameter file has several values.
    """
    if value != expected:
        raise InputError(
            f'{KEY} is {value}, which was not known when the node chose {expected}: '
            f'set it by -p {KEY}:={value}'
        )


@contextmanager
def wrap_rcl_errors() -> Iterator[None]:
    """Say in one line why the middleware cannot start, and which variable is to be changed.

    Raises:
        InputError: it cannot.
    """
    if not any(map(os.environ.get, LOG_VARIABLES)):
        raise InputError('ROS has no directory for its log: set ROS_LOG_DIR, or HOME')
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings('ignore', 'Failed to fini')  # it follows from the error
            yield
    except RCLError as error:
        text = ' '.join(str(error).split())
        hints = (hint for part, hint in HINTS.items() if part in text)
        raise InputError(f'ROS does not start: {text}{next(hints, "")}') from None


@contextmanager
def chosen_transport(choice: str) -> Iterator[str]:
    """Set the transport of the participant that is made meanwhile.

    Args:
        choice: ``'udp'``, without shared memory, or ``'default'``.

    Yields:
        The transport in force, as text for people.
    """
    middleware = get_rmw_implementation_identifier()
    user = next((name for name in USER_VARIABLES if os.environ.get(name)), '')
    if not user and Path(USER_PROFILES).is_file():
        user = USER_PROFILES
    if user:
        yield f'{middleware}, as {user} says'
    elif choice != 'udp' or not middleware.startswith('rmw_fastrtps'):
        yield f'{middleware}, its default'
    else:
        with _environment(_udp()):
            yield f'{middleware}, UDP'


def _udp() -> dict[str, str | None]:
    """Variables for UDP alone in the discovery range of this process; None: not set."""
    profiles = config.directory() / 'middleware'
    if os.environ.get(LOCALHOST_ONLY) == '1' or os.environ.get(DISCOVERY_RANGE) == 'LOCALHOST':
        # There rmw_fastrtps adds shared memory to any transport; in SYSTEM_DEFAULT, nothing.
        file = str(profiles / 'udp_localhost.xml')
        return {DISCOVERY_RANGE: 'SYSTEM_DEFAULT', LOCALHOST_ONLY: None, PROFILES: file}
    return {TRANSPORTS: 'UDPv4', PROFILES: str(profiles / 'udp.xml')}


@contextmanager
def _environment(changes: Mapping[str, str | None]) -> Iterator[None]:
    """Change variables for a while; processes started later shall choose for themselves."""
    before = {name: os.environ.get(name) for name in changes}
    try:
        _set(changes)
        yield
    finally:
        _set(before)


def _set(variables: Mapping[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _in_file(path: Path) -> str:
    """Value in a parameter file; empty when there is none, or no such file: rclpy will say so."""
    try:
        return _search(yaml.load(path.read_text(), LOADER))
    except (OSError, ValueError, yaml.YAMLError):
        return ''


def _search(tree: Any) -> str:
    """The last value in a tree of namespaces and nodes."""
    chosen = ''
    for key, branch in tree.items() if isinstance(tree, dict) else ():
        if key == 'ros__parameters' and isinstance(branch, dict):
            chosen = str(branch.get(KEY, chosen))
        else:
            chosen = _search(branch) or chosen
    return chosen


# The node of a command-line tool, which is in the ROS domain only for a while.


@contextmanager
def tool_node(name: str, transport: str = 'default', **options: Any) -> Iterator[Node]:
    """Start rclpy and make a node; both end with the context. Signals remain the tool's own.

    Args:
        name: Name of the node.
        transport: The parameter ``middleware``: ``'udp'`` or ``'default'``.
        options: Of :func:`rclpy.create_node`.

    Yields:
        The node.
    """
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        with wrap_rcl_errors(), chosen_transport(transport):
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node(name, **options)
        stack.callback(node.destroy_node)
        yield node
