"""Layouts of the message types that the suite writes and reads."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import cdr
from parallel_robot_model.messages.cdr import ENCAPSULATION, Layout

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


# Serialised messages of any length and content, read with their bounds checked.


class Reader:
    """Reads one message from beginning to end, and nothing beyond it.

    The generated deserialisers write a line to the terminal for each message that is broken.
    """

    def __init__(self, data: bytes) -> None:
        """Start to read.

        Raises:
            ValueError: it is not CDR, little endian.
        """
        if data[:2] != ENCAPSULATION[:2]:
            found = data[:2].hex() or 'empty'
            raise ValueError(f'its encapsulation is {found}, not that of CDR, little endian, 0001')
        self._data = memoryview(data)[len(ENCAPSULATION) :]
        self._at = 0

    def number(self, code: str) -> Any:
        """Read a number; `code` as in struct: i, I, d.

        Raises:
            ValueError: the message ends too early.
        """
        return struct.unpack('<' + code, self._take(struct.calcsize(code), 1))[0]

    def text(self) -> str:
        """Read a string.

        Raises:
            ValueError: the message ends too early, or the string is not UTF-8.
        """
        return bytes(self._take(1, self.number('I'))).rstrip(b'\0').decode()

    def texts(self) -> tuple[str, ...]:
        """Read a sequence of strings."""
        return tuple(self.text() for _ in range(self.number('I')))

    def numbers(self) -> np.ndarray:
        """Read a sequence of float64, shape (n,)."""
        count = self.number('I')
        return np.frombuffer(self._take(8, count) if count else b'', '<f8')

    def array(self) -> np.ndarray:
        """Read a std_msgs/Float64MultiArray of any dimensions, shape (n,)."""
        for _ in range(self.number('I')):  # dimensions: label, size, stride
            self.text(), self.number('I'), self.number('I')
        self.number('I')  # offset of the data
        return self.numbers()

    def header(self) -> str:
        """Read a std_msgs/Header; returns its frame."""
        self.number('i')
        self.number('I')
        return self.text()

    def _take(self, size: int, count: int) -> memoryview:
        """The next numbers of a size [bytes], aligned."""
        begin = self._at + -self._at % size
        self._at = begin + size * count
        if self._at > len(self._data):
            raise ValueError(f'ends before byte {self._at}')
        return self._data[begin : self._at]


def header_stamp(data: bytes) -> int | None:
    """Stamp of a serialised message that begins with a header [ns]; None if it is too short."""
    if len(data) < len(ENCAPSULATION) + 8:
        return None
    sec, nanosec = struct.unpack_from('<iI', data, len(ENCAPSULATION))
    return int(sec) * NANOSECONDS + int(nanosec)


def read_numbers(data: bytes) -> np.ndarray:
    """Numbers of a serialised std_msgs/Float64MultiArray of any dimensions, shape (n,).

    Empty, shape (0,), if the data is not such a message.
    """
    try:
        return Reader(data).array()
    except ValueError:
        return np.empty(0)


def last_state(data: bytes, joints: int) -> int | None:
    """Largest stamp in a message of ``controller/answered`` [ns]; None if it is not one."""
    count = (len(data) - 20) // 8
    if count <= 0 or count % (3 + joints):
        return None
    records = int64_multi_array(count).decode(data)
    if records is None:
        return None
    return int(records['data'].reshape(-1, 3 + joints)[:, :3].max())


# Layouts of messages with numbers for each joint, found from a message of any publisher.


class JointMessage(NamedTuple):
    """What a message with numbers for each joint holds."""

    names: tuple[str, ...]  # names of the joints
    fields: tuple[str, ...]  # fields with a number for each joint
    layout: Callable[[], cdr.Layout]  # makes the layout of messages like this one


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
        make = functools.partial(joint_trajectory, names, frame)
        return JointMessage(names, ('position', 'velocity', 'acceleration'), make)
    lengths = {name: len(message.numbers()) for name in ('position', 'velocity', 'effort')}
    fields = tuple(name for name, count in lengths.items() if count == len(names))
    return JointMessage(names, fields, functools.partial(joint_state, names, fields, frame))


def passive_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the passive joints, one beside each of the actuated `joints`."""
    return tuple(f'{joint}_passive' for joint in joints)


OWN: dict[str, Callable[[tuple[str, ...]], cdr.Layout]] = {  # as the suite publishes them
    'sensor_msgs/msg/JointState': joint_state,
    'trajectory_msgs/msg/JointTrajectory': joint_trajectory,
}
