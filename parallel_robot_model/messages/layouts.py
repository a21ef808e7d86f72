"""Layouts of the message types that the suite writes and reads."""

from __future__ import annotations

import functools
from collections.abc import Mapping

from parallel_robot_model.messages.cdr import Layout

KINDS = 16  # number of layouts that are kept for a type


@functools.lru_cache(KINDS)
def joint_state(
    joints: tuple[str, ...],
    fields: tuple[str, ...] = ('position', 'velocity', 'effort'),
    frame: str = '',
) -> Layout:
    """sensor_msgs/JointState with one number for every name in each of `fields`, else empty."""
    layout = Layout('sensor_msgs/msg/JointState').header(frame).texts(joints)
    for name in ('position', 'velocity', 'effort'):
        layout.numbers(name, len(joints) if name in fields else 0)
    return layout


@functools.lru_cache(KINDS)
def joint_trajectory(joints: tuple[str, ...], frame: str = '') -> Layout:
    """trajectory_msgs/JointTrajectory with one point, meant for its header's stamp."""
    count = len(joints)
    layout = Layout('trajectory_msgs/msg/JointTrajectory').header(frame).texts(joints)
    layout.constant('I', 1)
    layout.numbers('position', count).numbers('velocity', count).numbers('acceleration', count)
    return layout.numbers('effort', 0).constant('i', 0).constant('I', 0)


@functools.lru_cache
def float64_multi_array(count: int) -> Layout:
    """std_msgs/Float64MultiArray with `count` values and no dimensions, as ros2_control takes."""
    layout = Layout('std_msgs/msg/Float64MultiArray').constant('I', 0).constant('I', 0)
    return layout.numbers('data', count)


@functools.lru_cache
def int64_multi_array(count: int) -> Layout:
    """std_msgs/Int64MultiArray with `count` values and no dimensions."""
    layout = Layout('std_msgs/msg/Int64MultiArray').constant('I', 0).constant('I', 0)
    return layout.integers('data', count)


@functools.lru_cache
def pose_stamped(frame: str) -> Layout:
    """geometry_msgs/PoseStamped."""
    layout = Layout('geometry_msgs/msg/PoseStamped').header(frame)
    for name in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'):
        layout.number(name, 'f8')
    return layout


def diagnostic_array(
    name: str,
    level: int,
    text: str,
    values: Mapping[str, str],
    hardware: str = '',
    frame: str = '',
) -> Layout:
    """diagnostic_msgs/DiagnosticArray with one status; only its stamp varies."""
    layout = Layout('diagnostic_msgs/msg/DiagnosticArray').header(frame)
    layout.constant('I', 1).constant('B', level)
    layout.text(name).text(text).text(hardware).constant('I', len(values))
    for key, value in values.items():
        layout.text(key).text(value)
    return layout


def text_message(value: str) -> bytes:
    """Serialise a std_msgs/String, padded as on the wire."""
    return padded(Layout('std_msgs/msg/String').text(value).template.tobytes())


def padded(data: bytes) -> bytes:
    """A message padded to four bytes, as DDS does on the wire."""
    return data + bytes(-len(data) % 4)


def clock() -> Layout:
    """rosgraph_msgs/Clock."""
    return Layout('rosgraph_msgs/msg/Clock').stamp()
