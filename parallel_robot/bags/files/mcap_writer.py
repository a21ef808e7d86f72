"""Writes MCAP files, with messages in chunks that are packed by Zstandard."""

from __future__ import annotations

import contextlib
import struct
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
import zstandard
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from parallel_robot.bags.files.mcap_records import (
    ENTRIES,
    ENTRY,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    MESSAGES,
    RECORD,
    packed,
)

INDEX_HEAD = struct.Struct('<HI')  # of an index of messages: channel, bytes of its entries
SUMMARY = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
)
CRC = 4  # bytes at the end of a footer


class Rows(NamedTuple):
    """Messages of a topic, in the order in which they are written."""

    topic: str  # its name without leading slash
    # where each stands among those of other topics that are written at once, shape (N,)
    places: NDArray[np.int64]
    log_times: NDArray[np.int64]  # times [ns], shape (N,)
    # the messages, N of any length, or bytes of shape (N, L)
    payloads: Sequence[bytes] | NDArray[np.uint8]

    def records(self, channel: int) -> list[bytes]:
        """Their records, with the number of their channel."""
        heads = np.zeros(len(self.places), MESSAGES)
        heads['opcode'], heads['channel'] = Opcode.MESSAGE, channel
        heads['log_time'] = heads['publish_time'] = self.log_times
        if isinstance(self.payloads, np.ndarray):
            heads['length'] = MESSAGE_HEAD + self.payloads.shape[1]
            whole = np.hstack([heads.view(np.uint8).reshape(len(heads), -1), self.payloads])
            data, size = whole.tobytes(), whole.shape[1]
            return [data[begin : begin + size] for begin in range(0, len(data), size)]
        heads['length'] = [MESSAGE_HEAD + len(payload) for payload in self.payloads]
        return [head.tobytes() + each for head, each in zip(heads, self.payloads, strict=True)]


class McapWriter:
    """Writes a file; each write reaches the operating system whole or not at all.

    So the file ends with its last whole record, also when the disk becomes full: OSError.
    """

    def __init__(self, path: Path, chunk_size: int) -> None:
        """Create the file.

        Args:
            path: Where it will be; must not exist.
            chunk_size: Bytes of a chunk's content, which its last message exceeds.
        """
        self._file = path.open('xb', buffering=0)
        self.size = 0  # length of the file [bytes]
        self.written_at = time.monotonic()  # time of the last write on the monotonic clock [s]
        self._crc = 0  # of all that is written
        self._chunk_size = chunk_size
        self._chunk: list[bytes] = []  # records of the open chunk
        self._chunk_length = 0  # bytes
        self._entries: defaultdict[int, bytearray] = defaultdict(bytearray)  # of it, by channel
        self._statistics = mcap.Statistics(0, 0, Counter(), 0, 0, 0, 0, 0, 0)  # without it
        self._summary = {opcode: bytearray() for opcode in SUMMARY}
        self._write(MAGIC)
        self._write(packed(mcap.Header('ros2', 'parallel_robot')))

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._file.closed

    def statistics(self) -> mcap.Statistics:
        """Count what was written by now, with the messages of the open chunk."""
        before = self._statistics
        if not self._entries:
            return before
        counts, (first, last) = Counter(before.channel_message_counts), self._chunk_times()
        counts.update({k: len(each) // ENTRY.size for k, each in self._entries.items()})
        if before.message_count:
            first = min(first, before.message_start_time)
            last = max(last, before.message_end_time)
        return replace(
            before,
            channel_message_counts=counts,
            message_count=counts.total(),
            message_start_time=first,
            message_end_time=last,
        )

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a type; returns its number."""
        self._statistics.schema_count += 1
        number = self._statistics.schema_count
        self._declare(Opcode.SCHEMA, mcap.Schema(number, data, encoding, name))
        return number

    def channel(self, topic: str, schema: int, metadata: dict[str, str]) -> int:
        """Declare a topic of a type by its number; returns the number of its channel."""
        self._statistics.channel_count += 1
        number = self._statistics.channel_count
        self._declare(Opcode.CHANNEL, mcap.Channel(number, topic, 'cdr', metadata, schema))
        return number

    def append(
        self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Append a message of a channel by its number; times in nanoseconds."""
        self._entries[channel] += ENTRY.pack(log_time, self._chunk_length)
        length = MESSAGE_HEAD + len(data)
        head = MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence, log_time, publish_time)
        self._extend_chunk([head, data], MESSAGE.size + len(data))

    def append_all(self, numbered: Sequence[tuple[int, Rows]]) -> Iterator[None]:
        """Append many messages of many channels in the order of their places, by chunks."""
        order = np.argsort(np.concatenate([rows.places for _, rows in numbered]), kind='stable')
        unordered = [record for channel, rows in numbered for record in rows.records(channel)]
        records = [unordered[k] for k in order.tolist()]
        counts = [len(rows.places) for _, rows in numbered]
        channels = np.repeat([channel for channel, _ in numbered], counts)[order]
        entries = np.empty(len(records), ENTRIES)
        entries['log_time'] = np.concatenate([rows.log_times for _, rows in numbered])[order]
        ends = np.cumsum([0, *map(len, records)], dtype=np.int64)
        begin = 0
        while begin < len(records):
            shift = self._chunk_length - int(ends[begin])
            stop = int(np.searchsorted(ends[1:], self._chunk_size - shift, side='right')) + 1
            part = slice(begin, min(stop, len(records)))
            entries['offset'][part] = ends[part] + shift
            found, places = np.unique(channels[part], return_index=True)
            for channel in found[np.argsort(places)].tolist():
                own = entries[part][channels[part] == channel]
                self._entries[channel] += own.tobytes()
            self._extend_chunk(records[part], int(ends[part.stop] - ends[begin]))
            begin = part.stop
            yield

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Write a metadata record; unlike a message, it goes to the operating system at once."""
        begin, size = self._write(packed(mcap.Metadata(name, dict(facts))))
        self._statistics.metadata_count += 1
        self._summary[Opcode.METADATA_INDEX] += packed(mcap.MetadataIndex(begin, size, name))

    def attach(self, name: str, data: bytes, kind: str = 'text/plain', at: int = 0) -> None:
        """Write an attachment of a media type, made at a time [ns]; 0: now."""
        now = time.time_ns()
        made = at or now
        begin, size = self._write(packed(mcap.Attachment(made, now, name, kind, data)))
        self._statistics.attachment_count += 1
        index = mcap.AttachmentIndex(begin, size, now, made, len(data), name, kind)
        self._summary[Opcode.ATTACHMENT_INDEX] += packed(index)

    def finish_chunk(self) -> None:
        """Write the open chunk, if it has messages."""
        if not self._entries:
            return
        content, (first, last) = b''.join(self._chunk), self._chunk_times()
        data, size = zstandard.compress(content), len(content)
        chunk = mcap.Chunk('zstd', data, last, first, crc32(content), size)
        begin, length = self._write(packed(chunk))
        indices, offsets = b'', {}
        for channel, entries in self._entries.items():
            offsets[channel] = self.size + len(indices)
            indices += RECORD.pack(Opcode.MESSAGE_INDEX, INDEX_HEAD.size + len(entries))
            indices += INDEX_HEAD.pack(channel, len(entries)) + entries
        self._write(indices)
        index = mcap.ChunkIndex(
            length, begin, 'zstd', len(data), last, len(indices), offsets, first, size
        )
        self._summary[Opcode.CHUNK_INDEX] += packed(index)
        self._statistics = self.statistics()
        self._statistics.chunk_count += 1
        self._chunk, self._chunk_length = [], 0
        self._entries.clear()

    def finish(self) -> None:
        """Write the rest and the summary."""
        self.finish_chunk()
        self._write(packed(mcap.DataEnd(self._crc)))
        self._summary[Opcode.STATISTICS] += packed(self._statistics)
        begin, summary, offsets = self.size, bytearray(), b''
        for opcode, group in self._summary.items():
            offset = mcap.SummaryOffset(opcode, begin + len(summary), len(group))
            offsets += packed(offset)
            summary += group
        end = begin + len(summary)
        summary += offsets
        crc = crc32(summary + packed(mcap.Footer(begin, end, 0))[:-CRC])
        self._write(summary)
        self._write(packed(mcap.Footer(begin, end, crc)))
        self._write(MAGIC)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _declare(self, opcode: Opcode, record: mcap.McapRecord) -> None:
        data = packed(record)
        self._summary[opcode] += data
        self._extend_chunk([data], len(data))

    def _extend_chunk(self, records: list[bytes], length: int) -> None:
        self._chunk += records
        self._chunk_length += length
        if self._chunk_length > self._chunk_size:
            self.finish_chunk()

    def _chunk_times(self) -> tuple[int, int]:
        """Log times of the first and the last message of the open chunk [ns]."""
        times = np.frombuffer(b''.join(self._entries.values()), ENTRIES)['log_time']
        return int(times.min()), int(times.max())

    def _write(self, data: bytes | bytearray) -> tuple[int, int]:
        """Append; at an error, take back what was written and close.

        Returns:
            Where it begins and how long it is [bytes].
        """
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            with self._file, contextlib.suppress(OSError):
                self._file.truncate(self.size)
            raise
        begin, self.size = self.size, self.size + len(data)
        self._crc = crc32(data, self._crc)
        self.written_at = time.monotonic()
        return begin, len(data)
