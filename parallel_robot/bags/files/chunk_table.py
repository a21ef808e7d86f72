"""Where the chunks of a bag lie, in a few bytes each: a long bag has many."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.files.mcap_block import HEAD, LENGTH

FIELDS = 5  # numbers of a chunk
INDEX = struct.Struct('<QQQQI')  # times, place, length, bytes of the offsets that follow
OFFSET = struct.Struct('<HQ')  # of the messages of a channel
SIZES = 16  # bytes of both sizes of the content, after the name of its compression


class Chunk(NamedTuple):
    """Where a chunk lies.

    Attributes:
        first: First log time [ns].
        last: Last log time [ns].
        offset: Where it begins in its file [bytes]; in one of sqlite3, its first row.
        length: How long it is [bytes]; in one of sqlite3, rows from the first to the last.
        channels: Numbers of its channels; empty where they are not known.
        file: Number of its file.
    """

    first: int
    last: int
    offset: int
    length: int
    channels: tuple[int, ...] = ()
    file: int = 0


class ChunkTable:
    """The chunks of a file."""

    def __init__(self) -> None:
        """Begin without any."""
        self._numbers = array('Q')
        self.channels: dict[tuple[int, ...], int] = {}  # of many chunks, once

    def __len__(self) -> int:
        """How many there are."""
        return len(self._numbers) // FIELDS

    def add(
        self, first: int, last: int, offset: int, length: int, channels: tuple[int, ...] = ()
    ) -> None:
        """Take the next chunk, see :class:`Chunk`."""
        kind = self.channels.setdefault(channels, len(self.channels))
        self._numbers.extend((first, last, offset, length, kind))

    def add_index(self, record: memoryview) -> None:
        """Take a chunk by the record of its index; nothing of a broken one."""
        begin = HEAD + INDEX.size
        if len(record) < begin:
            return
        first, last, offset, length, size = INDEX.unpack_from(record, HEAD)
        name = begin + size + LENGTH.size  # where the length of the compression's name is
        if size % OFFSET.size or name + 4 > len(record):
            return
        end = name + 4 + int.from_bytes(record[name : name + 4], 'little') + SIZES
        channels = tuple(key for key, _ in OFFSET.iter_unpack(record[begin : begin + size]))
        if end <= len(record) and len({*channels}) == len(channels):
            self.add(first, last, offset, length, channels)

    def numbers(self) -> np.ndarray:
        """Numbers of the chunks by their places, each place once, shape (N, FIELDS)."""
        found = np.frombuffer(self._numbers, np.uint64).reshape(-1, FIELDS)[::-1]
        _, last = np.unique(found[:, 2], return_index=True)
        return found[last]


class Chunks:
    """The chunks of the files of a bag, by their first log times; else by their places."""

    def __init__(self, tables: Sequence[ChunkTable]) -> None:
        """Take the chunks of all files."""
        parts = [table.numbers() for table in tables]
        numbers = np.concatenate([np.empty((0, FIELDS), np.uint64), *parts])
        order = np.argsort(numbers[:, 0], kind='stable')
        self._numbers = numbers[order]
        self._files = np.repeat(np.arange(len(parts)), [*map(len, parts)])[order]
        self._channels = [[*table.channels] for table in tables]

    @property
    def first(self) -> np.ndarray:
        """First log times [ns], shape (N,)."""
        return self._numbers[:, 0]

    @property
    def last(self) -> np.ndarray:
        """Last log times [ns], shape (N,)."""
        return self._numbers[:, 1]

    def __len__(self) -> int:
        """How many there are."""
        return len(self._numbers)

    def __iter__(self) -> Iterator[Chunk]:
        """One after the other."""
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, k: int) -> Chunk:
        """The chunk of a number, which may count from the end."""
        first, last, offset, length, kind = self._numbers[k].tolist()
        file = int(self._files[k])
        return Chunk(first, last, offset, length, self._channels[file][kind], file)
