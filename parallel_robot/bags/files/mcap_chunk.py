"""Chunks of an MCAP file: unpacked, verified, and where the records in them begin."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from typing import NamedTuple
from zlib import crc32

import lz4.frame
import numpy as np
import zstandard

from parallel_robot.bags.files.mcap_block import HEAD, LENGTH, record_starts
from parallel_robot.bags.limits import CHUNK, Allowance

CHUNK_HEAD = struct.Struct('<QQQII')  # times, size, CRC, length of the compression's name

LONGEST_NAME = 16  # bytes of the name of a compression


class PackedChunk(NamedTuple):
    """A chunk whose lengths fit together.

    Attributes:
        compression: Key of UNPACK, or the name of another compression.
        size: Of the content [bytes].
        crc: CRC-32 of the content; 0: not known.
        packed: The packed content.
    """

    compression: bytes
    size: int
    crc: int
    packed: memoryview


class Content(NamedTuple):
    """Verified content of a chunk.

    Attributes:
        data: The bytes.
        starts: Where each record begins, shape (N,).
        opcodes: Their kinds, shape (N,).
    """

    data: memoryview
    starts: np.ndarray
    opcodes: np.ndarray


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
    if begin > len(record) or not is_compression(name):
        return None
    (length,) = LENGTH.unpack_from(record, begin - LENGTH.size)
    if length > len(record) - begin or (exact and length < len(record) - begin):
        return None
    return PackedChunk(name, size, crc, record[begin : begin + length])


def is_compression(name: bytes) -> bool:
    """Whether bytes can be the name of a compression."""
    return name in UNPACK or (len(name) <= LONGEST_NAME and name.isalnum())


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
    unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    return unpacked


UNPACK: dict[bytes, Callable[[memoryview, int], bytes | memoryview]] = {
    b'': lambda packed, _: packed,
    b'lz4': _unpack_lz4,
    b'zstd': _unpack_zstd,
}
