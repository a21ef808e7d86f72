"""What closes the loops of a URDF, from the YAML file beside it.

Source:
    Batto, de Matteis, Mansard (2025), Extended URDF, arXiv 2504.04767: `closed_loop` are pairs of
    frames that coincide, `type` says whether in position (3d) or in rotation, too (6d),
    `name_mot` are the actuated joints, `joint_name` are those that are of the kinds `joint_type`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import plain_data, yaml_file
from parallel_robot_model.configuration.xml_tree import Node

KEYS = ('closed_loop', 'type', 'name_mot', 'joint_name', 'joint_type')


def add(robot: Node, path: Path) -> None:
    """Add what stands in the YAML file of the same name, if there is one, to a URDF.

    Elements `closed_loop` with `first`, `second` and `type`, `name_mot` and `joint_type` with
    `joint` and `type`.

    Args:
        robot: The outermost element of the URDF.
        path: Its file.

    Raises:
        InputError: the YAML file does not have the form of the source.
    """
    beside = path.with_suffix('.yaml')
    if not beside.exists():
        return
    try:
        data = plain_data.load(yaml_file.text(beside))
    except ValueError as error:
        raise InputError(f'{beside}: {printable(error)}') from None
    if not isinstance(data, dict) or not set(KEYS) & set(data):
        return
    lists = {key: _list(beside, key, data.get(key) or []) for key in KEYS}
    kinds = lists['type'] or ['6d'] * len(lists['closed_loop'])
    for key, first, second in (
        ('type', lists['closed_loop'], kinds),
        ('joint_type', lists['joint_name'], lists['joint_type']),
    ):
        if len(first) != len(second):
            raise InputError(f'{beside}: {key} has {len(second)} values, not {len(first)}')
    for pair, kind in zip(lists['closed_loop'], kinds, strict=True):
        if not isinstance(pair, list) or len(pair) != 2:
            raise InputError(
                f'{beside}: closed_loop holds pairs of frames, not {printable(pair)!r}'
            )
        _append(robot, beside, 'closed_loop', first=pair[0], second=pair[1], type=kind)
    for joint in lists['name_mot']:
        _append(robot, beside, 'name_mot', joint=joint)
    for joint, kind in zip(lists['joint_name'], lists['joint_type'], strict=True):
        _append(robot, beside, 'joint_type', joint=joint, type=kind)


def _list(path: Path, key: str, value: Any) -> list[Any]:
    if isinstance(value, list):
        return value
    raise InputError(f'{path}: {key} must be a list, not {printable(value)!r}')


def _append(robot: Node, path: Path, tag: str, **attributes: Any) -> None:
    for name, value in attributes.items():
        if not isinstance(value, str):
            raise InputError(f'{path}: {tag}: {name} must be a name, not {printable(value)!r}')
    robot.append(Node(tag, attributes))
