"""Messages of fixed length as numpy records: one layout packs, unpacks, writes and reads them.

A JointState of three joints always has the same 156 bytes but for its numbers, so a message is a
structured array with gaps: a whole run is packed or read in one assignment, and the padding is
zero, which the generated serialisers do not promise (they leave what was in memory there).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

ENCAPSULATION = b'\x00\x01\x00\x00'  # CDR, little endian
NANOSECONDS = 1_000_000_000  # in one second


class Layout:
    """Byte layout of one message type with all lengths known.

    Attributes:
        type_name: ROS name of the type, e.g. ``'sensor_msgs/msg/JointState'``.
        dtype: The numbers that vary, at their offsets; ``itemsize`` is the message length.
        stamped: Whether the message begins with a header, i.e. has ``sec`` and ``nanosec``.
    """

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self._bytes = bytearray(ENCAPSULATION)
        self._fields: dict[str, tuple[str, int]] = {}

    def constant(self, code: str, value: int) -> Layout:
        """Append a number that never varies, e.g. the length of a sequence."""
        self._align(struct.calcsize(code))
        self._bytes += struct.pack('<' + code, value)
        return self

    def number(self, name: str, code: str) -> Layout:
        """Append a number that varies; `code` as in numpy: i4, u4, f8."""
        size = int(code[1:])
        self._align(size)
        self._fields[name] = ('<' + code, len(self._bytes))
        self._bytes += bytes(size)
        return self

    def text(self, value: str) -> Layout:
        """Append a string that never varies."""
        encoded = value.encode() + b'\0'
        self.constant('I', len(encoded))
        self._bytes += encoded
        return self

    def numbers(self, name: str, count: int) -> Layout:
        """Append a sequence of float64."""
        self.constant('I', count)
        if count:
            self._align(8)
            self._fields[name] = (f'({count},)<f8', len(self._bytes))
            self._bytes += bytes(8 * count)
        return self

    def stamp(self) -> Layout:
        """Append a builtin_interfaces/Time."""
        return self.number('sec', 'i4').number('nanosec', 'u4')

    def header(self, frame: str = '') -> Layout:
        """Append a std_msgs/Header."""
        return self.stamp().text(frame)

    def texts(self, values: Sequence[str]) -> Layout:
        """Append a sequence of strings that never vary."""
        self.constant('I', len(values))
        for value in values:
            self.text(value)
        return self

    def _align(self, size: int) -> None:
        self._bytes += bytes(-(len(self._bytes) - len(ENCAPSULATION)) % size)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured type of one message; the constant bytes lie between its fields."""
        return np.dtype(
            {
                'names': list(self._fields),
                'formats': [code for code, _ in self._fields.values()],
                'offsets': [offset for _, offset in self._fields.values()],
                'itemsize': len(self._bytes),
            }
        )

    @property
    def stamped(self) -> bool:
        """Whether the message carries a stamp."""
        return 'sec' in self._fields

    def blank(self, count: int) -> np.ndarray:
        """Make `count` records with every constant in place and every number zero."""
        raw = np.frombuffer(bytes(self._bytes) * count, dtype=np.uint8).copy()
        return raw.view(self.dtype)


def pack(records: np.ndarray, stamps: Any = None, **values: Any) -> np.ndarray:
    """Fill records in place.

    Args:
        records: Shape (N,), from :meth:`Layout.blank`.
        stamps: Nanoseconds, a number or shape (N,); None for types without a stamp.
        values: Field name to numbers, shape (n,) or (N, n).

    Returns:
        The same records.
    """
    if stamps is not None:
        records['sec'], records['nanosec'] = divmod(stamps, NANOSECONDS)
    for name, value in values.items():
        records[name] = value
    return records


class Codec:
    """Packs and unpacks single messages of one layout."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._dtype = layout.dtype
        self._record = layout.blank(1)
        self._size = self._record.nbytes
        self._constant = np.ones(self._size, dtype=bool)
        for format_, offset in layout._fields.values():
            self._constant[offset : offset + np.dtype(format_).itemsize] = False
        self._constants = self._record.view(np.uint8)[self._constant].tobytes()

    def encode(self, stamp: int | None = None, **values: Any) -> bytes:
        """Serialise one message; `stamp` in nanoseconds."""
        return pack(self._record, stamp, **values).tobytes()

    def decode(self, data: bytes) -> np.void | None:
        """Read one message; None when its fixed part (names, lengths) is not this layout's."""
        if len(data) != self._size:
            return None
        raw = np.frombuffer(data, dtype=np.uint8)
        if raw[self._constant].tobytes() != self._constants:
            return None
        record: np.void = raw.view(self._dtype)[0]
        return record


def joint_state(joints: Sequence[str]) -> Layout:
    """sensor_msgs/JointState with position, velocity and effort for every name."""
    layout = Layout('sensor_msgs/msg/JointState').header().texts(joints)
    return (
        layout.numbers('position', len(joints))
        .numbers('velocity', len(joints))
        .numbers('effort', len(joints))
    )


def joint_trajectory(joints: Sequence[str]) -> Layout:
    """trajectory_msgs/JointTrajectory with one point, meant for its header's stamp."""
    count = len(joints)
    layout = Layout('trajectory_msgs/msg/JointTrajectory').header().texts(joints).constant('I', 1)
    layout.numbers('position', count).numbers('velocity', count).numbers('acceleration', count)
    return layout.numbers('effort', 0).constant('i', 0).constant('I', 0)


def float64_multi_array(count: int) -> Layout:
    """std_msgs/Float64MultiArray with `count` values and no dimensions, as ros2_control takes."""
    layout = Layout('std_msgs/msg/Float64MultiArray').constant('I', 0).constant('I', 0)
    return layout.numbers('data', count)


def pose_stamped(frame: str) -> Layout:
    """geometry_msgs/PoseStamped."""
    layout = Layout('geometry_msgs/msg/PoseStamped').header(frame)
    for name in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'):
        layout.number(name, 'f8')
    return layout


def text_message(value: str) -> Layout:
    """std_msgs/String."""
    return Layout('std_msgs/msg/String').text(value)


def clock() -> Layout:
    """rosgraph_msgs/Clock."""
    return Layout('rosgraph_msgs/msg/Clock').stamp()
