"""Walks an MCAP file record by record, past whatever is damaged, and verifies every chunk."""

from __future__ import annotations

import contextlib
import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema, Statistics

from parallel_robot_bags.limits import ATTACHMENT, CHUNK, DESCRIPTION, Allowance
from parallel_robot_base.kernel import kernel

MAGIC = b'\x89MCAP0\r\n'
HEAD = 9  # bytes before the content of a record: opcode and length
MESSAGE_HEAD = 22  # bytes of a message's content before its payload
FOOTER = b'\x02\x14' + bytes(7)  # head of the footer
TAIL = len(FOOTER) + 20 + len(MAGIC)  # bytes from the footer to the end of the file
PIECE, LARGEST_PIECE = 1 << 12, 1 << 20  # bytes among which the next chunk is looked for
BATCH = 1 << 16  # messages outside chunks that make one block
MESSAGE = np.dtype(
    {
        'names': ['length', 'channel', 'sequence', 'log_time', 'publish_time'],
        'formats': ['<u8', '<u2', '<u4', '<u8', '<u8'],
        'offsets': [1, 9, 11, 15, 23],
        'itemsize': HEAD + MESSAGE_HEAD,
    }
)
LENGTH = struct.Struct('<Q')
CHUNK_HEAD = struct.Struct('<QQQII')  # times, size, CRC, length of the compression's name
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


class Block(NamedTuple):
    """Messages whose channels are known.

    Attributes:
        data: Content of a verified chunk, or the file where messages stand outside chunks.
        starts: Where the record of each message begins, shape (N,).
    """

    data: memoryview
    starts: np.ndarray

    def heads(self) -> np.ndarray:
        """What stands before the payloads, see MESSAGE, shape (N,)."""
        return self.cut(0, MESSAGE.itemsize).view(MESSAGE)

    def cut(self, begin: int, length: int, where: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Same bytes of many records.

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


class Damage(NamedTuple):
    """What is not as it was written.

    Attributes:
        what: In words.
        length: How much of the file is lost [bytes].
    """

    what: str
    length: int


Record = Header | Schema | Channel | Attachment | Metadata | Statistics | Block | Damage


def scan(data: memoryview, allowance: Allowance) -> Iterator[Record]:
    """Yield what a file holds: what its summary repeats, then its data in their order.

    Memory stays within the size of one chunk, whatever the lengths in the file say. After damage
    the walk goes on with the next chunk. A file without end is damage at its end.

    Args:
        data: The file.
        allowance: What reading it may take.

    Raises:
        BagError: it takes more.
    """
    summary, repeated = summarised(data, allowance)
    yield from repeated
    channels = np.zeros(1 << 16, bool)  # which are known, by their number
    channels[[record.id for record in repeated if isinstance(record, Channel)]] = True
    stop = len(data) if summary is None else summary
    offset = min(len(MAGIC), stop)
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
            if sound and crc and crc != zlib.crc32(data[:offset]):
                yield Damage('outside chunks', 0)
            offset = end
            break
        if opcode == Opcode.MESSAGE:
            starts, end = _starts(np.frombuffer(data, np.uint8), offset, stop, opcode, BATCH)
            allowance.walk(len(starts))
            yield from _known(Block(data, starts), channels)
        elif opcode == Opcode.CHUNK:
            content = unpacked(record, allowance)
            if content is None:
                sound = False
                yield Damage('chunk', len(record))
            else:
                yield from _contents(content, channels, allowance)
        elif opcode in PARSED:
            allowance.describe()
            parsed = _parsed(record)
            if isinstance(parsed, Channel):
                channels[parsed.id] = True
            yield parsed
        offset = end
    if summary is None:
        yield Damage('end', len(data) - offset)


def plain(payload: bytes, allowance: Allowance) -> bytes:
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


def summarised(
    data: memoryview, allowance: Allowance, kinds: Mapping[int, Any] = SUMMARISED
) -> tuple[int | None, list[Any]]:
    """Where the summary begins and what it repeats; None when the file has no sound end.

    Args:
        data: The file.
        allowance: What reading it may take.
        kinds: Records that are wanted.

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
    if not len(MAGIC) <= begin <= tail or (crc and crc != zlib.crc32(data[begin:checked])):
        return None, []
    starts, _ = _starts(np.frombuffer(data, np.uint8), begin, tail, 0, (tail - begin) // HEAD)
    wanted = starts[np.isin(np.frombuffer(data, np.uint8)[starts], list(kinds))].tolist()
    allowance.describe(len(wanted))
    records = [_parsed(_record(data, start), kinds) for start in wanted]
    return begin, [record for record in records if record is not None]


def unpacked(record: memoryview, allowance: Allowance) -> memoryview | None:
    """Verified content of a chunk; None when it is damaged.

    Raises:
        BagError: it takes more than is allowed.
    """
    parts = _packed(record)
    if parts is None or parts[1] > CHUNK:
        return None
    compression, size, crc, rest = parts
    allowance.unpack(size)
    try:
        content = UNPACK[compression](rest, size) if size else b''
    except Exception:  # in broken bytes, anything can go wrong
        return None
    if len(content) != size or (crc and crc != zlib.crc32(content)):
        return None
    return memoryview(content)


def messages_of(content: memoryview, allowance: Allowance) -> Block | None:
    """All messages of a verified chunk; None when its records do not fill it.

    Raises:
        BagError: they are more than is allowed.
    """
    starts = _filling(content, allowance)
    if starts is None:
        return None
    return Block(content, starts[_opcodes(content, starts) == Opcode.MESSAGE])


def record_at(data: memoryview, offset: int, opcode: int) -> memoryview | None:
    """The record of a kind at an offset; None when there is none."""
    end = _end(data, offset, len(data)) if 0 <= offset < len(data) else None
    return None if end is None or data[offset] != opcode else data[offset:end]


def _end(data: memoryview, offset: int, stop: int) -> int | None:
    """End of the record at `offset`; None when it is none, or one whose lengths are wrong."""
    content = offset + HEAD
    if content > stop:
        return None
    opcode = data[offset]
    (length,) = LENGTH.unpack_from(data, offset + 1)
    end = content + length
    if end > stop:
        return None
    if opcode == Opcode.CHUNK:
        whole = _packed(data[offset:end]) is not None
    elif opcode == Opcode.MESSAGE:
        whole = length >= MESSAGE_HEAD
    elif opcode == Opcode.MESSAGE_INDEX:
        whole = length >= 6 and struct.unpack_from('<I', data, content + 2)[0] == length - 6
    elif opcode == Opcode.DATA_END:
        whole = length == 4
    elif opcode in PARSED:
        whole = _parsed(data[offset:end]) is not None
    else:
        whole = False
    return end if whole else None


def _next_chunk(data: memoryview, offset: int, stop: int) -> int:
    """Where the next chunk begins whose lengths fit together; `stop` when there is none."""
    raw = np.frombuffer(data, np.uint8)
    size = PIECE
    while offset < stop:
        found = offset + np.flatnonzero(raw[offset : min(offset + size, stop)] == Opcode.CHUNK)
        found = found[found + HEAD <= stop]
        for start in found[raw[found + HEAD - 1] == 0].tolist():
            if CHUNK_BEGIN.match(data, start, stop) and _end(data, start, stop) is not None:
                return int(start)
        offset, size = offset + size, min(2 * size, LARGEST_PIECE)
    return stop


def _record(data: memoryview, start: int) -> memoryview:
    return data[start : start + HEAD + LENGTH.unpack_from(data, start + 1)[0]]


def _parsed(record: memoryview, kinds: Mapping[int, Any] = PARSED) -> Any:
    """A record as mcap's class; None unless it would be written with these very bytes."""
    if len(record) > (ATTACHMENT if record[0] == Opcode.ATTACHMENT else DESCRIPTION):
        return None
    builder = RecordBuilder()
    try:
        parsed = kinds[record[0]].read(ReadDataStream(BytesIO(record[HEAD:])))
        parsed.write(builder)
    except Exception:  # in broken bytes, any length or string can be wrong
        return None
    return parsed if builder.end() == record else None


def _packed(record: memoryview) -> tuple[bytes, int, int, memoryview] | None:
    """Compression, size, CRC and packed content of a chunk; None if its lengths are wrong."""
    if len(record) < HEAD + CHUNK_HEAD.size:
        return None
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(record, HEAD)
    name = record[HEAD + CHUNK_HEAD.size :][:name_length]
    packed = record[HEAD + CHUNK_HEAD.size + name_length + LENGTH.size :]
    written = record[HEAD + CHUNK_HEAD.size + name_length :][: LENGTH.size]
    if written != LENGTH.pack(len(packed)) or bytes(name) not in UNPACK:
        return None
    return bytes(name), size, crc, packed


def _unpack_zstd(packed: bytes | memoryview, size: int) -> bytes:
    if zstandard.frame_content_size(packed) not in (-1, size):  # it would be allocated
        raise ValueError
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def _unpack_lz4(packed: memoryview, size: int) -> bytes:
    unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    return unpacked


UNPACK: dict[bytes, Callable[[memoryview, int], bytes | memoryview]] = {
    b'': lambda packed, _: packed,
    b'lz4': _unpack_lz4,
    b'zstd': _unpack_zstd,
}


def _contents(content: memoryview, channels: np.ndarray, allowance: Allowance) -> Iterator[Any]:
    """Records of a verified chunk; adds to the known `channels`."""
    starts = _filling(content, allowance)
    if starts is None:
        yield Damage('chunk', len(content))
        return
    opcodes = _opcodes(content, starts)
    described = starts[(opcodes == Opcode.SCHEMA) | (opcodes == Opcode.CHANNEL)].tolist()
    allowance.describe(len(described))
    for start in described:
        parsed = _parsed(_record(content, start))
        if isinstance(parsed, Channel):
            channels[parsed.id] = True
        if parsed is not None:
            yield parsed
    yield from _known(Block(content, starts[opcodes == Opcode.MESSAGE]), channels)


def _filling(content: memoryview, allowance: Allowance) -> np.ndarray | None:
    """Where the records of a chunk begin, shape (N,); None when they do not fill it."""
    if not len(content):
        return np.empty(0, np.int64)
    raw = np.frombuffer(content, np.uint8)
    most = min(len(raw) // HEAD, allowance.records + 1)
    starts, end = _starts(raw, 0, len(raw), 0, most)
    allowance.walk(len(starts))
    return starts if end == len(raw) else None


def _opcodes(content: memoryview, starts: np.ndarray) -> np.ndarray:
    return np.frombuffer(content, np.uint8)[starts] if len(starts) else np.empty(0, np.uint8)


def _known(block: Block, channels: np.ndarray) -> Iterator[Block | Damage]:
    """The messages of a block whose channels are known."""
    heads = block.heads()
    known = channels[heads['channel']]
    if not known.all():
        yield Damage('messages of unknown topics', int(heads['length'][~known].sum()))
    if known.any():
        yield Block(block.data, block.starts[known])


@kernel
def _starts(
    raw: np.ndarray, offset: int, stop: int, opcode: int, count: int
) -> tuple[np.ndarray, int]:
    """Where records begin that follow one another.

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
