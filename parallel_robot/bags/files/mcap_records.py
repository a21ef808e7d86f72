"""Records of MCAP files, for reading and writing: messages, and the chunks that hold them."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import Any, NamedTuple
from zlib import crc32

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Header,
    McapRecord,
    Metadata,
    Schema,
    Statistics,
)

from parallel_robot.bags.limits import ATTACHMENT, CHUNK, DESCRIPTION, Allowance
from parallel_robot_model.compiler import kernel

MAGIC = b'\x89MCAP0\r\n'
RECORD = struct.Struct('<BQ')  # opcode of a record, length of its content
HEAD = RECORD.size
LENGTH = struct.Struct('<Q')
CHUNK_HEAD = struct.Struct('<QQQII')  # times, size, CRC, length of the compression's name
INDEX_HEAD = struct.Struct('<QQQQI')  # times, place, length, bytes of the offsets that follow
NUMBERED = struct.Struct('<HQ')  # number of a channel, and a count or an offset
MESSAGE = struct.Struct('<BQHIQQ')  # a record of a message before its payload
MESSAGE_HEAD = MESSAGE.size - HEAD
MESSAGES = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)  # the same of many messages
ENTRY = struct.Struct('<QQ')  # of an index of messages: log time, and where in its chunk
ENTRIES = np.dtype([('log_time', '<u8'), ('offset', '<u8')])  # the same of many
LONGEST_NAME = 16  # bytes of the name of a compression

PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.STATISTICS: Statistics,
}


def packed(record: McapRecord) -> bytes:
    """A record as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def parsed(record: memoryview, exact: bool = False) -> Any:
    """A record as mcap's class; None unless these bytes begin with what that class writes.

    What a later version of the format may add at the end is left out, as its specification says;
    `exact`: there must be nothing of the kind.
    """
    if len(record) > (ATTACHMENT if record[0] == Opcode.ATTACHMENT else DESCRIPTION):
        return None
    try:
        found = PARSED[record[0]].read(ReadDataStream(BytesIO(record[HEAD:])))
        written = memoryview(packed(found))[HEAD:]
    except Exception:  # in broken bytes, any length or string can be wrong
        return None
    content = record[HEAD:] if exact else record[HEAD : HEAD + len(written)]
    if record[0] == Opcode.ATTACHMENT and content[-4:] == bytes(4):  # a CRC of zero is none
        written, content = written[:-4], content[:-4]
    return found if content == written else None


class Block(NamedTuple):
    """Messages whose channels are known."""

    # content of a verified chunk, or the file where messages stand outside chunks
    data: memoryview
    starts: np.ndarray  # where the record of each message begins, shape (N,)
    # where the record of the chunk begins in its file, and ends; None: outside chunks
    place: tuple[int, int] | None = None

    def heads(self) -> np.ndarray:
        """Fields in front of the payloads, see MESSAGES, shape (N,)."""
        return self.cut(0, MESSAGES.itemsize).view(MESSAGES)

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
    """Verified content of a chunk; None when it is damaged or its records do not fill it."""
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
