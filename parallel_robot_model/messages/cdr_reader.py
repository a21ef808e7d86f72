"""Serialised messages of any length and content, read with their bounds checked."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.cdr import ENCAPSULATION
from parallel_robot_model.messages.layouts import int64_multi_array


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
