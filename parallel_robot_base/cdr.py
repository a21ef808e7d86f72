"""Messages of fixed length as numpy records: one layout packs, unpacks, writes and reads them.

A JointState of three joints always has the same 156 bytes but for its numbers, so a message is a
structured array with gaps: a whole run is packed or read in one assignment, and the padding is
zero, which the generated serialisers do not promise (they leave what was in memory there).
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from parallel_robot_base.units import NANOSECONDS

ENCAPSULATION = b'\x00\x01\x00\x00'  # CDR, little endian
KINDS = 16  # layouts of a type that are kept
SPARE = 8  # bytes; some serialisers leave fewer than this at the end of a message


class Layout:
    """Byte layout of one message type with all lengths known.

    Attributes:
        type_name: ROS name of the type, e.g. ``'sensor_msgs/msg/JointState'``.
    """

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self._bytes = bytearray(ENCAPSULATION)
        self._constant = bytearray(b'\1' * len(ENCAPSULATION))  # 1 where a byte never varies
        self._fields: dict[str, tuple[str, int]] = {}

    def constant(self, code: str, value: int) -> Layout:
        """Append a number that never varies, e.g. the length of a sequence."""
        self._align(struct.calcsize(code))
        self._append(struct.pack('<' + code, value))
        return self

    def number(self, name: str, code: str) -> Layout:
        """Append a number that varies; `code` as in numpy: i4, u4, f8."""
        size = int(code[1:])
        self._align(size)
        self._fields[name] = ('<' + code, len(self._bytes))
        self._append(bytes(size), constant=False)
        return self

    def text(self, value: str) -> Layout:
        """Append a string that never varies."""
        encoded = value.encode() + b'\0'
        self.constant('I', len(encoded))
        self._append(encoded)
        return self

    def numbers(self, name: str, count: int) -> Layout:
        """Append a sequence of float64."""
        self.constant('I', count)
        if count:
            self._align(8)
            self._fields[name] = (f'({count},)<f8', len(self._bytes))
            self._append(bytes(8 * count), constant=False)
        return self

    def integers(self, name: str, count: int) -> Layout:
        """Append a sequence of int64."""
        self.constant('I', count)
        if count:
            self._align(8)
            self._fields[name] = (f'({count},)<i8', len(self._bytes))
            self._append(bytes(8 * count), constant=False)
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

    def _append(self, data: bytes, constant: bool = True) -> None:
        self._bytes += data
        self._constant += bytes([constant]) * len(data)

    def _align(self, size: int) -> None:
        self._append(bytes(-(len(self._bytes) - len(ENCAPSULATION)) % size), constant=False)

    @functools.cached_property
    def template(self) -> np.ndarray:
        """Bytes of a message whose numbers are zero."""
        return np.frombuffer(bytes(self._bytes), dtype=np.uint8)

    @functools.cached_property
    def constants(self) -> np.ndarray:
        """Indices of the bytes that never vary, but for padding, whose content means nothing."""
        return np.flatnonzero(np.frombuffer(bytes(self._constant), dtype=np.uint8))

    @functools.cached_property
    def fixed(self) -> np.ndarray:
        """The bytes at :attr:`constants`."""
        return self.template[self.constants]

    @functools.cached_property
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

    def records(self, count: int, stamps: Any = None, **values: Any) -> np.ndarray:
        """Make messages, constants in place and numbers filled in.

        Args:
            count: Number of messages N.
            stamps: Nanoseconds, a number or shape (N,); None for types without a stamp.
            values: Field name to numbers, shape (n,) or (N, n); fields not named stay zero.

        Returns:
            Structured array, shape (N,); ``records[k].tobytes()`` is message k.
        """
        raw = np.frombuffer(bytes(self._bytes) * count, dtype=np.uint8).copy()
        records = raw.view(self.dtype)
        if stamps is not None:
            records['sec'], records['nanosec'] = divmod(stamps, NANOSECONDS)
        for name, value in values.items():
            records[name] = value
        return records

    def draft(self) -> Draft:
        """A message to be filled in place."""
        return Draft(self)

    def encode(self, stamp: int | None = None, **values: Any) -> bytes:
        """Serialise one message."""
        return self.records(1, stamp, **values).tobytes()

    def decode(self, data: bytes, count: int = 1) -> np.ndarray | None:
        """Read messages that lie end to end.

        Args:
            data: Serialised messages.
            count: How many they should be, N.

        Returns:
            Structured array, shape (N,); None when the length or a fixed part (names, counts) is
            not this layout's.
        """
        length = count * len(self._bytes)
        if not length <= len(data) < length + SPARE:
            return None
        raw = np.frombuffer(data, dtype=np.uint8, count=length)
        rows = raw.reshape(count, len(self._bytes))
        if not (rows[:, self.constants] == self.fixed).all():
            return None
        return raw.view(self.dtype)


class Draft:
    """One message that is filled in place, again and again: quicker than a new one each time.

    Attributes:
        bytes: Of the message, uint8.
        fields: Name to the numbers of the field, aligned, shape (n,).
    """

    def __init__(self, layout: Layout) -> None:
        begin = len(ENCAPSULATION)  # CDR aligns from there
        self.bytes = np.zeros(begin + len(layout.template), np.uint8)[begin:]
        self.bytes[:] = layout.template
        record = self.bytes.view(layout.dtype)
        self.fields = {name: record[name].reshape(-1) for name in layout.dtype.names or ()}

    def encode(self, stamp: int, **values: Any) -> bytes:
        """Serialise with a stamp [ns]; fields not named stay as they were."""
        fields = self.fields
        fields['sec'][0], fields['nanosec'][0] = divmod(stamp, NANOSECONDS)
        for name, value in values.items():
            fields[name][:] = value
        return self.bytes.tobytes()


class Reader:
    """Reads one message from its begin to its end, and nothing behind it.

    The generated deserialisers write a line to the terminal for each message that is broken.
    """

    def __init__(self, data: bytes) -> None:
        """Begin to read.

        Raises:
            ValueError: it is not CDR, little endian.
        """
        if data[:2] != ENCAPSULATION[:2]:
            raise ValueError('not CDR, little endian')
        self._data = memoryview(data)[len(ENCAPSULATION) :]
        self._at = 0

    def number(self, code: str) -> Any:
        """Read a number; `code` as in struct: i, I, d.

        Raises:
            ValueError: the message ends before.
        """
        return struct.unpack('<' + code, self._take(struct.calcsize(code), 1))[0]

    def text(self) -> str:
        """Read a string.

        Raises:
            ValueError: the message ends before, or it is no UTF-8.
        """
        return bytes(self._take(1, self.number('I'))).rstrip(b'\0').decode()

    def texts(self) -> tuple[str, ...]:
        """Read a sequence of strings."""
        return tuple(self.text() for _ in range(self.number('I')))

    def numbers(self) -> np.ndarray:
        """Read a sequence of float64, shape (n,)."""
        count = self.number('I')
        return np.frombuffer(self._take(8, count) if count else b'', '<f8')

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
    """Stamp of a serialised message that begins with a header [ns]; None when it is too short."""
    if len(data) < len(ENCAPSULATION) + 8:
        return None
    sec, nanosec = struct.unpack_from('<iI', data, len(ENCAPSULATION))
    return int(sec) * NANOSECONDS + int(nanosec)


def read_numbers(data: bytes) -> np.ndarray:
    """Numbers of a serialised std_msgs/Float64MultiArray of any dimensions, shape (n,).

    None where it is not one: shape (0,).
    """
    try:
        message = Reader(data)
        for _ in range(message.number('I')):  # dimensions: label, size, stride
            message.text(), message.number('I'), message.number('I')
        message.number('I')  # of what comes before the data
        return message.numbers()
    except ValueError:
        return np.empty(0)


def last_state(data: bytes) -> int | None:
    """Largest stamp in a serialised std_msgs/Int64MultiArray of stamps [ns]; None when empty."""
    layout = int64_multi_array((len(data) - 20) // 8)
    records = layout.decode(data) if len(data) >= 28 else None
    return int(records['data'].max()) if records is not None else None


def stamps_of(records: np.ndarray) -> np.ndarray:
    """Stamps of messages [ns], shape (N,), int64."""
    return records['sec'].astype(np.int64) * NANOSECONDS + records['nanosec']


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
    name: str, level: int, text: str, values: Mapping[str, str], hardware: str = ''
) -> Layout:
    """diagnostic_msgs/DiagnosticArray with one status; only its stamp varies."""
    layout = Layout('diagnostic_msgs/msg/DiagnosticArray').header()
    layout.constant('I', 1).constant('B', level)
    layout.text(name).text(text).text(hardware).constant('I', len(values))
    for key, value in values.items():
        layout.text(key).text(value)
    return layout


def text_message(value: str) -> bytes:
    """Serialise a std_msgs/String, filled up as on the wire."""
    return filled(Layout('std_msgs/msg/String').text(value).template.tobytes())


def filled(data: bytes) -> bytes:
    """A message filled up to four bytes, as DDS does on the wire."""
    return data + bytes(-len(data) % 4)


def clock() -> Layout:
    """rosgraph_msgs/Clock."""
    return Layout('rosgraph_msgs/msg/Clock').stamp()
