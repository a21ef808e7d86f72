"""What the server needs of what it shows: a running graph or a bag."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from parallel_robot.analysis.report.looks import joint_label
from parallel_robot.live.frames import Camera
from parallel_robot.watch.robots import NODES, SILENT, Robot
from parallel_robot_control.laws import title
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.configuration.yaml_file import is_configuration


class RefusedError(ParallelRobotError):
    """What a browser asked for was refused; the text says why."""


class Description(NamedTuple):
    """What a node says of a parameter."""

    text: str  # its meaning, with the unit in brackets
    low: float | None  # smallest value, if there is one
    high: float | None  # largest value, likewise
    fixed: bool = False  # whether it cannot be changed


# What the page says in words and numbers, as plain data.

UNIT = re.compile(r'(.*?)(?: \[([^\]]*)\])?', re.DOTALL)
SHAPE = 'trajectory.shape'
LARGEST = 1e300  # a range that ends there has no end
UNKNOWN = Description('', None, None)  # of a parameter that a node was given and does not use


def frame_layout(camera: Camera) -> dict[str, Any]:
    """What the numbers of a frame are."""
    return {
        'number': camera.number,
        'place': camera.place,
        'parts': camera.parts,
        'curves': [
            {'group': curve.group, 'name': joint_label(curve.name)} for curve in camera.curves
        ],
        'efforts': camera.units.label('Torques'),
        'units': {'joints': _unit(camera, 'rad'), 'torque': _unit(camera, 'N m')},
    }


def _unit(camera: Camera, unit: str) -> str:
    """Unit of the joints, in brackets where a prefix is to be that of two."""
    told = camera.units.of(unit)
    return f'({told})' if ' or ' in told else told


def robot_state(robot: Robot, now: float) -> dict[str, Any]:
    """Law, fault, limits, times and nodes of a robot.

    Args:
        robot: What its nodes report.
        now: Time [s].
    """
    known = [name for name in NODES if name in robot.nodes]
    lag = robot.value('controller', 'lag p50/p99/max [ms]').split('/')
    return {
        'law': robot.law,
        'title': title(robot.law),
        'fault': '' if robot.fault == 'none' else robot.fault,
        'limits': '' if robot.limits == 'none' else robot.limits,
        'lag': lag if len(lag) == 3 else [],
        'answered': robot.value('controller', 'answered'),
        'skipped': robot.value('controller', 'skipped'),
        'nodes': [
            {
                'name': name,
                'rate': robot.value(name, 'rate [Hz]'),
                'processor': robot.value(name, 'processor [%]'),
                'level': robot.nodes[name].level,
                'says': robot.nodes[name].text,
                'silent': int(now - robot.nodes[name].time)
                if now - robot.nodes[name].time >= SILENT
                else 0,
            }
            for name in [*known, *sorted(set(robot.nodes) - set(known))]
        ],
    }


def laws_and_shapes(
    nodes: Mapping[str, Mapping[str, Any]],
    descriptions: Mapping[str, Mapping[str, Description]],
    laws: Iterable[str],
) -> dict[str, Any]:
    """Laws with their gains, and shapes of the motion with their parameters.

    Args:
        nodes: Parameters of each node.
        descriptions: What each says of them; a node may have those of another, and nothing to say.
        laws: Names of the laws.
    """
    parameters, motion = nodes.get('controller', {}), nodes.get('trajectory', {})
    told, of_shapes = (descriptions.get(node, {}) for node in ('controller', 'trajectory'))
    gains: dict[str, list[dict[str, Any]]] = {name: [] for name in laws}
    for key, value in parameters.items():
        law, _, name = key.partition('.')
        if law in gains and name and key in told:
            gains[law].append(_parameter(key, value, told))
    shapes: dict[str, list[dict[str, Any]]] = {}
    for key in motion_parameters(motion, of_shapes):
        if key != SHAPE:
            parameter = _parameter(key, motion[key], of_shapes)
            shapes.setdefault(key.partition('.')[0], []).append(parameter)
    common = shapes.pop('trajectory', [])
    return {
        'shape': motion.get(SHAPE, ''),
        'shapes': {name: [*own, *common] for name, own in shapes.items()},
        'scenario': parameters.get('scenario', ''),
        'robot': parameters.get('robot_model', ''),
        'preset': parameters.get('preset', ''),
        'laws': [{'name': law, 'title': title(law)} for law in gains],
        'gains': gains,
    }


def motion_parameters(
    parameters: Mapping[str, Any], descriptions: Mapping[str, Description]
) -> list[str]:
    """Keys of the parameters of a trajectory node that change its motion.

    It says nothing of those that it was given with others but does not know.
    """
    return [
        key
        for key in parameters
        if '.' in key
        and is_configuration(key)
        and descriptions.get(key, UNKNOWN) != UNKNOWN
        and not descriptions[key].fixed
    ]


def _parameter(key: str, value: Any, descriptions: Mapping[str, Description]) -> dict[str, Any]:
    """Key, name, value, meaning, unit and range of a parameter."""
    name = key.partition('.')[2]
    return {'key': key, 'name': name, 'value': value, **_told(descriptions[key])}


def _told(description: Description) -> dict[str, Any]:
    found = UNIT.fullmatch(description.text)
    text, unit = found.groups() if found else (description.text, '')
    low, high = (
        None if bound is None or abs(bound) > LARGEST else bound
        for bound in (description.low, description.high)
    )
    return {'text': text, 'unit': unit or '', 'low': low, 'high': high}
