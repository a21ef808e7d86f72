"""Walks an MCAP file record by record, past damaged parts, and verifies every chunk."""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema, Statistics

from parallel_robot.bags.files.bag_files import release
from parallel_robot.bags.files.mcap_records import (
    HEAD,
    INDEX_HEAD,
    LENGTH,
    MAGIC,
    MESSAGE_HEAD,
    NUMBERED,
    PARSED,
    RECORD,
    Block,
    Content,
    chunk_content,
    packed_chunk,
    parsed,
    record_starts,
    unknown_compression,
)
from parallel_robot.bags.limits import CHUNK_INDEX, Allowance

FOOTER = RECORD.pack(Opcode.FOOTER, 20)
TAIL = len(FOOTER) + 20 + len(MAGIC)  # bytes from the footer to the end of the file
PIECE, LARGEST_PIECE = 1 << 12, 1 << 20  # bytes searched at a time for the next chunk
HELD = 1 << 26  # bytes of a file that are held in memory
BATCH = 1 << 16  # messages outside chunks that make one block
SUMMARISED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS)
NEW = 0x10  # opcode from which on records are of later versions, from 0x80 on private ones
UNPACKED_BY = 'chunks compressed by'  # a compression that is not known
UNFINISHED = 'end'  # the damage of a file that was not closed
CHUNK_BEGIN = re.compile(rb'\x06.{7}\x00.{28}(?:\0\0\0\0|\x03\0\0\0lz4|\x04\0\0\0zstd)', re.DOTALL)


class Damage(NamedTuple):
    """A damaged part of a file."""

    what: str  # what is damaged, in words
    length: int  # how much of the file is lost [bytes]


Record = Header | Schema | Channel | Attachment | Metadata | Statistics | Block | Damage


def scan(
    data: memoryview, allowance: Allowance, skipped: Collection[int] = ()
) -> Iterator[Record]:
    """Yield what a file holds: what its summary repeats, then its data in their order.

    Memory stays within the size of one chunk, whatever the lengths in the file say. After damage
    the walk goes on with the next chunk. A file without end is damage at its end.

    Args:
        data: The file.
        allowance: Budget for reading it.
        skipped: Where chunks begin that are not wanted.
    """
    summary, repeated = summarised(data, allowance)
    yield from repeated
    channels = np.zeros(1 << 16, bool)  # whether each number is a known channel
    channels[[record.id for record in repeated if isinstance(record, Channel)]] = True
    stop = len(data) if summary is None else summary
    offset = held = min(len(MAGIC), stop)
    sound = data[:offset] == MAGIC
    if not sound and offset:
        yield Damage('magic', offset)
    while offset < stop:
        opcode, end = data[offset], _end(data, offset, stop)
        if end is None:
            resume = _next_chunk(data, offset + 1, stop)
            if resume == len(data):
                break
            yield Damage('record', resume - offset)
            sound, offset = False, resume
            continue
        record = data[offset:end]
        allowance.walk(1)
        if opcode == Opcode.DATA_END:
            (crc,) = struct.unpack_from('<I', record, HEAD)
            if sound and crc and crc != crc32(data[:offset]):
                yield Damage('outside chunks', 0)
            offset = end
            break
        if opcode == Opcode.MESSAGE:
            starts, end = record_starts(np.frombuffer(data, np.uint8), offset, stop, opcode, BATCH)
            allowance.walk(len(starts))
            yield from _known(Block(data, starts), channels)
        elif opcode == Opcode.CHUNK and offset in skipped:
            sound = False  # what is not read is not verified
        elif opcode == Opcode.CHUNK:
            content = chunk_content(record, allowance)
            if content is None:
                sound = False
                name = unknown_compression(record)
                yield Damage(f'{UNPACKED_BY} {name}' if name else 'chunk', len(record))
            else:
                yield from _records(content, channels, allowance, (offset, end))
        elif opcode in PARSED:
            allowance.describe()
            described = parsed(record)
            if isinstance(described, Channel):
                channels[described.id] = True
            yield described
        offset = end
        if offset > held + HELD:
            release(data)
            held = offset
    if summary is None:
        yield Damage(UNFINISHED, len(data) - offset)


def summarised(
    data: memoryview, allowance: Allowance, chunks: ChunkTable | None = None
) -> tuple[int | None, list[Any]]:
    """Where the summary begins and what it repeats; None when the file has no sound end.

    Args:
        data: The file.
        allowance: Budget for reading it.
        chunks: Takes what it says of the chunks; None: that is not wanted.

    Raises:
        BagError: it takes more.
    """
    tail = len(data) - TAIL
    if tail < len(MAGIC) or data[tail : tail + HEAD] != FOOTER or data[-len(MAGIC) :] != MAGIC:
        return None, []
    begin, _, crc = struct.unpack_from('<QQI', data, tail + HEAD)
    if begin == 0:
        return tail, []
    checked = tail + HEAD + 2 * LENGTH.size
    if not len(MAGIC) <= begin <= tail or (crc and crc != crc32(data[begin:checked])):
        return None, []
    starts, _ = record_starts(
        np.frombuffer(data, np.uint8), begin, tail, 0, (tail - begin) // HEAD
    )
    opcodes = np.frombuffer(data, np.uint8)[starts]
    wanted = starts[np.isin(opcodes, SUMMARISED)].tolist()
    allowance.describe(len(wanted))
    if chunks is not None:
        for start in starts[opcodes == Opcode.CHUNK_INDEX].tolist():
            record = _record(data, start)
            allowance.hold(len(record))
            chunks.add_index(record)
    records = [parsed(_record(data, start)) for start in wanted]
    return begin, [record for record in records if record is not None]


def index(data: memoryview, allowance: Allowance, chunks: ChunkTable) -> list[Any] | None:
    """What the summary of a file would hold that was not closed; None where more is wrong with it.

    Its last record may be cut off. Messages outside chunks are not indexed.

    Args:
        data: The file.
        allowance: Budget for reading it.
        chunks: Takes where its chunks lie.

    Raises:
        BagError: it takes more.
    """
    described: dict[tuple[type, int], Any] = {}  # by kind and number: many chunks repeat them
    counts = np.zeros(1 << 16, np.int64)
    for record in scan(data, allowance):
        if isinstance(record, (Schema, Channel)):
            described[type(record), record.id] = record
        elif isinstance(record, Block) and record.place is not None:
            heads = record.heads()
            counts += np.bincount(heads['channel'], minlength=len(counts))
            times = int(heads['log_time'].min()), int(heads['log_time'].max())
            allowance.hold(CHUNK_INDEX)
            begin, end = record.place
            chunks.add(*times, begin, end - begin)
        elif isinstance(record, Block) or (
            isinstance(record, Damage) and record.what != UNFINISHED
        ):
            return None
    by_channel = {int(k): int(counts[k]) for k in np.flatnonzero(counts)}
    counted = Statistics(0, 0, by_channel, 0, int(counts.sum()), 0, 0, 0, 0)
    return [*described.values(), counted]


def messages_at(data: memoryview, offset: int, allowance: Allowance) -> Block | None:
    """Messages of the chunk at an offset; None when there is none or it is damaged.

    Raises:
        BagError: it takes more than is allowed.
    """
    end = _end(data, offset, len(data)) if 0 <= offset < len(data) else None
    if end is None or data[offset] != Opcode.CHUNK:
        return None
    content = chunk_content(data[offset:end], allowance)
    return None if content is None else _messages(content)


def _end(data: memoryview, offset: int, stop: int, exact: bool = False) -> int | None:
    """End of the record at `offset`; None when no record with sound lengths begins there.

    One with more than it must have, or of an unknown kind, counts where another one follows it:
    else its length or its opcode is damaged.
    """
    end = _stated_end(data, offset, stop)
    if end is None or _is_whole(data[offset:end], exact=True):
        return end
    if exact or not _is_whole(data[offset:end], exact=False):
        return None
    follower: int | None = end
    while follower is not None and follower < stop and data[follower] >= NEW:
        follower = _stated_end(data, follower, stop)
    if follower is None or follower == stop:
        return end if follower == stop else None
    last = _stated_end(data, follower, stop)
    return end if last is not None and _is_whole(data[follower:last], exact=False) else None


def _stated_end(data: memoryview, offset: int, stop: int) -> int | None:
    """End of the record at `offset` by the length that it states; None beyond `stop`."""
    if offset + HEAD > stop:
        return None
    end = offset + HEAD + int(LENGTH.unpack_from(data, offset + 1)[0])
    return end if end <= stop else None


def _is_whole(record: memoryview, exact: bool) -> bool:
    """Whether the lengths in a record fit it; `exact`: and it has no more than it must have."""
    opcode, length = record[0], len(record) - HEAD
    if opcode == Opcode.CHUNK:
        return packed_chunk(record, exact) is not None
    if opcode == Opcode.MESSAGE:
        return length >= MESSAGE_HEAD
    if opcode == Opcode.MESSAGE_INDEX:
        least = 6 + struct.unpack_from('<I', record, HEAD + 2)[0] if length >= 6 else length + 1
    elif opcode == Opcode.DATA_END:
        least = 4
    elif opcode in PARSED:
        return parsed(record, exact=exact) is not None
    else:  # a chunk with another opcode is a damaged one
        return not exact and opcode >= NEW and packed_chunk(record, exact=True) is None
    return bool(least == length or (least < length and not exact))


def _next_chunk(data: memoryview, offset: int, stop: int) -> int:
    """Where the next chunk begins whose lengths fit together; `stop` when there is none."""
    raw, chunk = np.frombuffer(data, np.uint8), np.uint8(Opcode.CHUNK)  # else all are widened
    size = PIECE
    while offset < stop:
        found = offset + np.flatnonzero(raw[offset : min(offset + size, stop)] == chunk)
        found = found[found + HEAD <= stop]
        for start in found[raw[found + HEAD - 1] == 0].tolist():
            if (
                CHUNK_BEGIN.match(data, start, stop)
                and _end(data, start, stop, exact=True) is not None
            ):
                return int(start)
        offset, size = offset + size, min(2 * size, LARGEST_PIECE)
    return stop


def _record(data: memoryview, start: int) -> memoryview:
    return data[start : start + HEAD + LENGTH.unpack_from(data, start + 1)[0]]


def _records(
    content: Content, channels: np.ndarray, allowance: Allowance, place: tuple[int, int]
) -> Iterator[Schema | Channel | Block | Damage]:
    """Records of a verified chunk; adds to the known `channels`."""
    kinds = content.opcodes
    starts = content.starts[(kinds == Opcode.SCHEMA) | (kinds == Opcode.CHANNEL)].tolist()
    allowance.describe(len(starts))
    for start in starts:
        described = parsed(_record(content.data, start))
        if isinstance(described, Channel):
            channels[described.id] = True
        if described is not None:
            yield described
    yield from _known(_messages(content)._replace(place=place), channels)


def _messages(content: Content) -> Block:
    return Block(content.data, content.starts[content.opcodes == Opcode.MESSAGE])


def _known(block: Block, channels: np.ndarray) -> Iterator[Block | Damage]:
    """The messages of a block whose channels are known."""
    heads = block.heads()
    known = channels[heads['channel']]
    if not known.all():
        yield Damage('messages of unknown topics', int(heads['length'][~known].sum()))
    if known.any():
        yield block._replace(starts=block.starts[known])


# Where the chunks of a bag lie, in a few bytes each: a long bag has many.

FIELDS = 5  # numbers of a chunk
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
        begin = HEAD + INDEX_HEAD.size
        if len(record) < begin:
            return
        first, last, offset, length, size = INDEX_HEAD.unpack_from(record, HEAD)
        name = begin + size + LENGTH.size  # where the length of the compression's name is
        if size % NUMBERED.size or name + 4 > len(record):
            return
        end = name + 4 + int.from_bytes(record[name : name + 4], 'little') + SIZES
        channels = tuple(key for key, _ in NUMBERED.iter_unpack(record[begin : begin + size]))
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
