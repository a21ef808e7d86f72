"""Parameter files: keys and values, or the form in which ROS has them, by node."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.plain_data import Place, Placed, locating

NODES = ('trajectory', 'plant', 'controller', 'recorder', 'monitor')  # which have a configuration
ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service')  # of every node
OTHER_GROUPS = ('qos_overrides.', 'granted.')  # prefixes of what is not configuration
MOTION = 'granted.motion'  # the newest that the trajectory node took over while it ran, in words
CODE = {'custom_laws', 'custom_robots', 'custom_trajectories'}  # keys that name Python files
MARK = 'ros__parameters'  # between the name of a node and its parameters


def is_configuration(name: str) -> bool:
    """Whether a parameter of a node belongs to the configuration, as far as its name tells."""
    return name not in ROS_PARAMETERS and not name.startswith(OTHER_GROUPS)


def read(path: Path) -> Placed:
    """Read a parameter file.

    In the form of ROS, what is for a node wins over what is for all (``/**``), whatever the
    namespace; other nodes are left out with a warning, and so are parameters of ROS itself.

    Args:
        path: Its place.

    Returns:
        Dotted key to value.

    Raises:
        InputError: it cannot be read, names code, or gives two nodes different values of one key.
    """
    values = yaml_file.read(path)
    if is_of_ros(values):
        values = _by_node(path, values)
    for key in CODE & values.keys():
        if values[key]:
            with locating(values):
                raise InputError(f'{key} is code: give it by --set {key}=[FILE]', key)
        del values[key]
    return values


def is_of_ros(values: Mapping[str, Any]) -> bool:
    """Whether flat keys are those of a parameter file of ROS."""
    return any(MARK in key.split('.') for key in values)


def _by_node(path: Path, values: Placed) -> Placed:
    """Parameters of the nodes of the suite."""
    parameters: dict[str, tuple[Any, str, Place]] = {}  # value, the node that it is for, its place
    strangers = set()
    for own in (False, True):  # a node's own parameters count more than those for all
        for full, value in values.items():
            node, _, key = f'.{full}'.partition(f'.{MARK}.')
            node = node.removeprefix('.').replace('.', '/')
            if not key:
                raise InputError(f'{path}: {printable(full)} stands outside {MARK}')
            if not node:
                raise InputError(f'{path}: {MARK} must stand under the name of a node, or /**')
            name = node.rpartition('/')[2]
            if name not in NODES and '*' not in name:
                strangers.add(printable(node))
            elif (name in NODES) == own and is_configuration(key):
                before, other, _ = parameters.get(key, (value, '', None))
                if before != value and (other.rpartition('/')[2] in NODES or not own):
                    raise InputError(
                        f'{path}: {key} is {before} for {other} and {value} for {node}'
                    )
                parameters[key] = value, node, values.places[full]
    for name in sorted(strangers):
        text = f'{path}: {name} is not a node of the suite; its parameters are left out'
        logging.getLogger('parallel_robot').warning(text)
    return Placed(
        {key: value for key, (value, *_) in parameters.items()},
        {key: place for key, (*_, place) in parameters.items()},
    )
