"""A block of an MCAP file's messages: its bytes, and where the record of each message begins."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from parallel_robot_model.compiler import kernel

HEAD = 9  # bytes before the content of a record: opcode and length
MESSAGE_HEAD = 22  # bytes of a message's content before its payload
MESSAGE = np.dtype(
    {
        'names': ['length', 'channel', 'sequence', 'log_time', 'publish_time'],
        'formats': ['<u8', '<u2', '<u4', '<u8', '<u8'],
        'offsets': [1, 9, 11, 15, 23],
        'itemsize': HEAD + MESSAGE_HEAD,
    }
)
LENGTH = struct.Struct('<Q')


class Block(NamedTuple):
    """Messages whose channels are known.

    Attributes:
        data: Content of a verified chunk, or the file where messages stand outside chunks.
        starts: Where the record of each message begins, shape (N,).
    """

    data: memoryview
    starts: np.ndarray

    def heads(self) -> np.ndarray:
        """Fields in front of the payloads, see MESSAGE, shape (N,)."""
        return self.cut(0, MESSAGE.itemsize).view(MESSAGE)

    def cut(self, begin: int, length: int, where: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Cut the same bytes out of many records.

        Args:
            begin: First byte, from the beginning of a record.
            length: How many bytes, L.
            where: Which messages, M of N.

        Returns:
            Shape (M,), of a type of L bytes.
        """
        kind = np.dtype(f'V{length}')
        if not len(self.starts):
            return np.empty(0, kind)
        count = len(self.data) - length + 1
        every = np.ndarray((count,), kind, self.data, strides=(1,))  # at each offset, overlapping
        return every[self.starts[where] + begin]

    def rows(self, channels: list[int] | None = None) -> Iterator[tuple[int, ...]]:
        """Iterate over the messages.

        Args:
            channels: Numbers of the channels that are wanted; None: all.

        Yields:
            Channel, sequence number, log time and publish time [ns], and where in `data` the
            payload begins and ends.
        """
        heads, starts = self.heads(), self.starts
        if channels is not None:
            here = np.isin(heads['channel'], channels)
            heads, starts = heads[here], starts[here]
        begins, ends = starts + HEAD + MESSAGE_HEAD, starts + HEAD + heads['length'].astype(int)
        columns = [heads[name].tolist() for name in ('channel', 'sequence', 'log_time')]
        columns += [heads['publish_time'].tolist(), begins.tolist(), ends.tolist()]
        yield from zip(*columns, strict=True)


@kernel
def record_starts(
    raw: np.ndarray, offset: int, stop: int, opcode: int, count: int
) -> tuple[np.ndarray, int]:
    """Find where records begin that follow one another.

    Args:
        raw: Bytes, shape (N,).
        offset: Where the first begins.
        stop: Where the last may end.
        opcode: What they must be; 0 for any.
        count: How many they may be.

    Returns:
        Their offsets, and where the last ends.
    """
    starts = np.empty(count, np.int64)
    found = 0
    while found < count and offset + 9 <= stop and (opcode == 0 or raw[offset] == opcode):
        length = 0
        for k in range(7):
            length += int(raw[offset + 1 + k]) << (8 * k)
        short = raw[offset] == 5 and length < 22
        if raw[offset + 8] != 0 or length > stop - offset - 9 or short:
            break
        starts[found] = offset
        found += 1
        offset += 9 + length
    return starts[:found].copy(), offset
