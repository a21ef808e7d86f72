"""Chunks of an MCAP file, and the messages in them."""

from __future__ import annotations

import contextlib
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple
from zlib import crc32

import lz4.frame
import numpy as np
import zstandard

from parallel_robot.bags.limits import CHUNK, Allowance
from parallel_robot_model.compiler import kernel

# A block of an MCAP file's messages: its bytes, and where the record of each message begins.

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
    """Messages whose channels are known."""

    # content of a verified chunk, or the file where messages stand outside chunks
    data: memoryview
    starts: np.ndarray  # where the record of each message begins, shape (N,)

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


# Chunks of an MCAP file: unpacked, verified, and where the records in them begin.

CHUNK_HEAD = struct.Struct('<QQQII')  # times, size, CRC, length of the compression's name

LONGEST_NAME = 16  # bytes of the name of a compression


class PackedChunk(NamedTuple):
    """A chunk whose lengths fit together."""

    compression: bytes  # key of UNPACK, or the name of another compression
    size: int  # of the content [bytes]
    crc: int  # CRC-32 of the content; 0: not known
    packed: memoryview  # the packed content


class Content(NamedTuple):
    """Verified content of a chunk."""

    data: memoryview  # the bytes
    starts: np.ndarray  # where each record begins, shape (N,)
    opcodes: np.ndarray  # their kinds, shape (N,)


def packed_chunk(record: memoryview, exact: bool = False) -> PackedChunk | None:
    """Parts of a chunk's record; None if its lengths are wrong or its compression has no name.

    Args:
        record: The record.
        exact: Whether nothing may stand behind the content, as no recorder writes it.
    """
    if len(record) < HEAD + CHUNK_HEAD.size:
        return None
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(record, HEAD)
    name = bytes(record[HEAD + CHUNK_HEAD.size :][: min(name_length, LONGEST_NAME + 1)])
    begin = HEAD + CHUNK_HEAD.size + name_length + LENGTH.size
    named = name in UNPACK or (len(name) <= LONGEST_NAME and name.isalnum())
    if begin > len(record) or not named:
        return None
    (length,) = LENGTH.unpack_from(record, begin - LENGTH.size)
    if length > len(record) - begin or (exact and length < len(record) - begin):
        return None
    return PackedChunk(name, size, crc, record[begin : begin + length])


def unknown_compression(record: memoryview) -> str:
    """The compression of a chunk's record, where it is none of UNPACK; else empty."""
    chunk = packed_chunk(record)
    return '' if chunk is None or chunk.compression in UNPACK else chunk.compression.decode()


def chunk_content(record: memoryview, allowance: Allowance) -> Content | None:
    """Verified content of a chunk; None when it is damaged or its records do not fill it.

    Raises:
        BagError: it takes more than is allowed.
    """
    chunk = packed_chunk(record)
    if chunk is None or chunk.compression not in UNPACK or chunk.size > CHUNK:
        return None
    allowance.unpack(chunk.size)
    try:
        data = UNPACK[chunk.compression](chunk.packed, chunk.size) if chunk.size else b''
    except Exception:  # in broken bytes, anything can go wrong
        return None
    if len(data) != chunk.size or (chunk.crc and chunk.crc != crc32(data)):
        return None
    if not chunk.size:
        return Content(memoryview(b''), np.empty(0, np.int64), np.empty(0, np.uint8))
    raw = np.frombuffer(data, np.uint8)
    most = min(len(raw) // HEAD, allowance.records + 1)
    starts, end = record_starts(raw, 0, len(raw), 0, most)
    allowance.walk(len(starts))
    return Content(memoryview(data), starts, raw[starts]) if end == len(raw) else None


def unpacked_payload(payload: bytes, allowance: Allowance) -> bytes:
    """A payload, unpacked if its recorder packed each by itself; as it is when that fails.

    Raises:
        BagError: it takes more than is allowed.
    """
    if payload.startswith(zstandard.FRAME_HEADER):
        with contextlib.suppress(zstandard.ZstdError):
            size = zstandard.frame_content_size(payload)
            if 0 <= size <= CHUNK:
                allowance.unpack(size)
                return _unpack_zstd(payload, size)
    return payload


def _unpack_zstd(packed: bytes | memoryview, size: int) -> bytes:
    if zstandard.frame_content_size(packed) not in (-1, size):  # it would be allocated
        raise ValueError
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def _unpack_lz4(packed: memoryview, size: int) -> bytes:
    return lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)


UNPACK: dict[bytes, Callable[[memoryview, int], bytes | memoryview]] = {
    b'': lambda packed, _: packed,
    b'lz4': _unpack_lz4,
    b'zstd': _unpack_zstd,
}


# Where the chunks of a bag lie, in a few bytes each: a long bag has many.

FIELDS = 5  # numbers of a chunk
INDEX = struct.Struct('<QQQQI')  # times, place, length, bytes of the offsets that follow
OFFSET = struct.Struct('<HQ')  # of the messages of a channel
SIZES = 16  # bytes of both sizes of the content, after the name of its compression


class Chunk(NamedTuple):
    """Where a chunk lies."""

    first: int  # first log time [ns]
    last: int  # last log time [ns]
    offset: int  # where it begins in its file [bytes]; in one of sqlite3, its first row
    length: int  # how long it is [bytes]; in one of sqlite3, rows from the first to the last
    channels: tuple[int, ...] = ()  # numbers of its channels; empty where they are not known
    file: int = 0  # number of its file


class ChunkTable:
    """The chunks of a file."""

    def __init__(self) -> None:
        self._numbers = array('Q')
        self.channels: dict[tuple[int, ...], int] = {}  # of many chunks, once

    def __len__(self) -> int:
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
        return len(self._numbers)

    def __iter__(self) -> Iterator[Chunk]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, k: int) -> Chunk:
        """The chunk of a number, which may count from the end."""
        first, last, offset, length, kind = self._numbers[k].tolist()
        file = int(self._files[k])
        return Chunk(first, last, offset, length, self._channels[file][kind], file)
