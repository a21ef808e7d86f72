"""Layouts of messages with numbers for each joint, found from a message of any publisher."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

from parallel_robot_model.messages import cdr, layouts
from parallel_robot_model.messages.cdr_reader import Reader


class JointMessage(NamedTuple):
    """What a message with numbers for each joint holds.

    Attributes:
        names: Names of the joints.
        fields: Fields with a number for each joint.
        layout: Makes the layout of messages like this one.
    """

    names: tuple[str, ...]
    fields: tuple[str, ...]
    layout: Callable[[], cdr.Layout]


def joint_message(type_name: str, data: bytes) -> JointMessage:
    """Parse a message of one of the types in OWN, as far as its layout depends on it.

    Args:
        type_name: ROS name of the type.
        data: The serialised message.

    Raises:
        ValueError: it is not a message of this type.
    """
    message = Reader(data)
    frame, names = message.header(), message.texts()
    if type_name == 'trajectory_msgs/msg/JointTrajectory':
        make = functools.partial(layouts.joint_trajectory, names, frame)
        return JointMessage(names, ('position', 'velocity', 'acceleration'), make)
    lengths = {name: len(message.numbers()) for name in ('position', 'velocity', 'effort')}
    fields = tuple(name for name, count in lengths.items() if count == len(names))
    return JointMessage(
        names, fields, functools.partial(layouts.joint_state, names, fields, frame)
    )


def passive_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the passive joints, one beside each of the actuated `joints`."""
    return tuple(f'{joint}_passive' for joint in joints)


OWN: dict[str, Callable[[tuple[str, ...]], cdr.Layout]] = {  # as the suite publishes them
    'sensor_msgs/msg/JointState': layouts.joint_state,
    'trajectory_msgs/msg/JointTrajectory': layouts.joint_trajectory,
}
