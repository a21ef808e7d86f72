"""The configuration of a graph from what its nodes say, and values for its parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from parallel_robot.live.source import RefusedError
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.configuration import config

SEEN = re.compile(r'robot_model|joints|(robot|controller)\.')  # on which a picture depends
SHIPPED = 'paper_circle'  # where nothing is known of the scenario


def known_values(
    parameters: Mapping[str, Mapping[str, Any]], given: Mapping[str, Any] | None
) -> dict[str, Any]:
    """The configuration of a graph, as far as it is known.

    Code and files that the nodes name are not opened: they come over the wire.

    Args:
        parameters: Parameters by node.
        given: Configuration of a graph that was started here; None for any other.

    Raises:
        InputError: its robot is not one of the suite.
    """
    heard = {
        key: value
        for node in ('trajectory', 'controller')
        for key, value in parameters.get(node, {}).items()
        if value is not None and key not in config.CUSTOM
    }
    values = dict(given or _shipped(heard))
    return values | {key: value for key, value in heard.items() if key in values}


def of_robot(values: Mapping[str, Any]) -> dict[str, Any]:
    """What a picture of the robot depends on, of a configuration."""
    return {key: value for key, value in values.items() if SEEN.match(key)}


def _shipped(heard: Mapping[str, Any]) -> dict[str, Any]:
    scenario = str(heard.get('scenario', SHIPPED))
    if '/' not in scenario:
        try:
            return config.resolve(scenario)
        except ParallelRobotError:
            pass
    robot = str(heard.get('robot_model', 'planar_3rrr'))
    return config.resolve(SHIPPED, {'robot_model': robot})


def meant(key: str, present: Any, value: Any) -> Any:
    """A value from a browser as the type that a parameter has; its node checks the rest.

    A single number stands for all joints.

    Raises:
        RefusedError: it is of another type.
    """
    if isinstance(present, list) and present and isinstance(present[0], float):
        items = value if isinstance(value, list) else [value] * len(present)
        return [_number(key, item) for item in items]
    if isinstance(present, float):
        return _number(key, value)
    if type(value) is not type(present):
        raise RefusedError(f'{key} must be like {present!r}, not {value!r:.40}')
    return value


def _number(key: str, value: Any) -> float:
    try:
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return float(value)
    except OverflowError:
        pass
    raise RefusedError(f'{key} must be a number, not {value!r:.40}')
