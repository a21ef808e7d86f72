"""Walks an MCAP file record by record, past damaged parts, and verifies every chunk."""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator, Mapping
from io import BytesIO
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema, Statistics

from parallel_robot.bags.files.bag_files import release
from parallel_robot.bags.files.mcap_chunks import (
    HEAD,
    LENGTH,
    MESSAGE_HEAD,
    Block,
    ChunkTable,
    Content,
    chunk_content,
    packed_chunk,
    record_starts,
    unknown_compression,
)
from parallel_robot.bags.limits import ATTACHMENT, CHUNK_INDEX, DESCRIPTION, Allowance

MAGIC = b'\x89MCAP0\r\n'
FOOTER = b'\x02\x14' + bytes(7)  # head of the footer
TAIL = len(FOOTER) + 20 + len(MAGIC)  # bytes from the footer to the end of the file
PIECE, LARGEST_PIECE = 1 << 12, 1 << 20  # bytes searched at a time for the next chunk
HELD = 1 << 26  # bytes of a file that are held in memory
BATCH = 1 << 16  # messages outside chunks that make one block
NEW = 0x10  # opcode from which on records are of later versions, from 0x80 on private ones
UNPACKED_BY = 'chunks compressed by'  # a compression that is not known
CHUNK_BEGIN = re.compile(rb'\x06.{7}\x00.{28}(?:\0\0\0\0|\x03\0\0\0lz4|\x04\0\0\0zstd)', re.DOTALL)
PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.STATISTICS: Statistics,
}
SUMMARISED: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
}


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

    Raises:
        BagError: it takes more.
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
                yield from _records(content, channels, allowance)
        elif opcode in PARSED:
            allowance.describe()
            parsed = _parsed(record)
            if isinstance(parsed, Channel):
                channels[parsed.id] = True
            yield parsed
        offset = end
        if offset > held + HELD:
            release(data)
            held = offset
    if summary is None:
        yield Damage('end', len(data) - offset)


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
    wanted = starts[np.isin(opcodes, list(SUMMARISED))].tolist()
    allowance.describe(len(wanted))
    if chunks is not None:
        for start in starts[opcodes == Opcode.CHUNK_INDEX].tolist():
            record = _record(data, start)
            allowance.hold(len(record))
            chunks.add_index(record)
    records = [_parsed(_record(data, start), SUMMARISED) for start in wanted]
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
    if data[: len(MAGIC)] != MAGIC:
        return None
    described: dict[tuple[type, int], Any] = {}  # by kind and number: many chunks repeat them
    known, counts = np.zeros(1 << 16, bool), np.zeros(1 << 16, np.int64)
    offset = held = len(MAGIC)
    while offset < len(data) and data[offset] != Opcode.DATA_END:
        end = _end(data, offset, len(data))
        if end is None and _next_chunk(data, offset + 1, len(data)) == len(data):
            break
        if end is None or data[offset] == Opcode.MESSAGE:
            return None
        record = data[offset:end]
        allowance.walk(1)
        if data[offset] == Opcode.CHUNK:
            content = chunk_content(record, allowance)
            if content is None:
                return None
            for part in _records(content, known, allowance):
                if isinstance(part, Damage):
                    return None
                if not isinstance(part, Block):
                    described[type(part), part.id] = part
                    continue
                heads = part.heads()
                counts += np.bincount(heads['channel'], minlength=len(counts))
                times = int(heads['log_time'].min()), int(heads['log_time'].max())
                allowance.hold(CHUNK_INDEX)
                chunks.add(*times, offset, end - offset)
        elif data[offset] in (Opcode.SCHEMA, Opcode.CHANNEL):
            allowance.describe()
            parsed = _parsed(record)
            described[type(parsed), parsed.id] = parsed
            known[parsed.id] |= isinstance(parsed, Channel)
        offset = end
        if offset > held + HELD:
            release(data)
            held = offset
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
        return _parsed(record, PARSED, exact) is not None
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


def _parsed(record: memoryview, kinds: Mapping[int, Any] = PARSED, exact: bool = False) -> Any:
    """A record as mcap's class; None unless these bytes begin with what that class writes.

    What a later version of the format may add at the end is left out, as its specification says;
    `exact`: there must be nothing of the kind.
    """
    if len(record) > (ATTACHMENT if record[0] == Opcode.ATTACHMENT else DESCRIPTION):
        return None
    builder = RecordBuilder()
    try:
        parsed = kinds[record[0]].read(ReadDataStream(BytesIO(record[HEAD:])))
        parsed.write(builder)
    except Exception:  # in broken bytes, any length or string can be wrong
        return None
    written = memoryview(builder.end())[HEAD:]
    found = record[HEAD:] if exact else record[HEAD : HEAD + len(written)]
    unchecked = record[0] == Opcode.ATTACHMENT and found[-4:] == bytes(4)
    if unchecked:  # a CRC of zero is none
        written, found = written[:-4], found[:-4]
    return parsed if found == written else None


def _records(
    content: Content, channels: np.ndarray, allowance: Allowance
) -> Iterator[Schema | Channel | Block | Damage]:
    """Records of a verified chunk; adds to the known `channels`."""
    kinds = content.opcodes
    described = content.starts[(kinds == Opcode.SCHEMA) | (kinds == Opcode.CHANNEL)].tolist()
    allowance.describe(len(described))
    for start in described:
        parsed = _parsed(_record(content.data, start))
        if isinstance(parsed, Channel):
            channels[parsed.id] = True
        if parsed is not None:
            yield parsed
    yield from _known(_messages(content), channels)


def _messages(content: Content) -> Block:
    return Block(content.data, content.starts[content.opcodes == Opcode.MESSAGE])


def _known(block: Block, channels: np.ndarray) -> Iterator[Block | Damage]:
    """The messages of a block whose channels are known."""
    heads = block.heads()
    known = channels[heads['channel']]
    if not known.all():
        yield Damage('messages of unknown topics', int(heads['length'][~known].sum()))
    if known.any():
        yield Block(block.data, block.starts[known])
