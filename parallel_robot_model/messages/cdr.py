"""Messages of fixed length as numpy records: one layout packs, unpacks, writes and reads them.

A JointState of three joints always has the same 156 bytes except for its numbers, so a message is
a structured array with gaps: a whole run is packed or read in one assignment, and the padding is
zero, which the generated serialisers do not promise (they leave what was in memory there).
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.units import NANOSECONDS

ENCAPSULATION = b'\x00\x01\x00\x00'  # CDR, little endian
SPARE = 8  # bytes; some serialisers leave fewer than this at the end of a message


class Layout:
    """Byte layout of one message type with all lengths known."""

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name  # ROS name of the type, e.g. ``'sensor_msgs/msg/JointState'``
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
        """Indices of the bytes that never vary, without padding, whose content is arbitrary."""
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
            values: Field name to numbers, shape (n,) or (N, n); other fields stay zero.

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
    """One message that is filled in place repeatedly: faster than a new one each time."""

    def __init__(self, layout: Layout) -> None:
        begin = len(ENCAPSULATION)  # CDR aligns from there
        # bytes of the message, uint8
        self.bytes = np.zeros(begin + len(layout.template), np.uint8)[begin:]
        self.bytes[:] = layout.template
        record = self.bytes.view(layout.dtype)
        # name to the numbers of the field, aligned, shape (n,)
        self.fields = {name: record[name].reshape(-1) for name in layout.dtype.names or ()}

    def encode(self, stamp: int, **values: Any) -> bytes:
        """Serialise with a stamp [ns]; fields not named stay as they were."""
        fields = self.fields
        fields['sec'][0], fields['nanosec'][0] = divmod(stamp, NANOSECONDS)
        for name, value in values.items():
            fields[name][:] = value
        return self.bytes.tobytes()


def stamps_of(records: np.ndarray) -> np.ndarray:
    """Stamps of messages [ns], shape (N,), int64."""
    return records['sec'].astype(np.int64) * NANOSECONDS + records['nanosec']
