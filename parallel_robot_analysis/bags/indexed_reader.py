"""Reads bags of any size piece by piece: in the order of log times, from any moment on."""

from __future__ import annotations

import bisect
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

from parallel_robot_analysis.bags.bag_reader import files
from parallel_robot_interface.errors import BagError

RECORD = struct.Struct('<BQ')  # opcode, length of the rest
MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
MESSAGE_OPCODE = 5
TRANSIENT_LOCAL = ('transient_local', 1)  # as bags say it: today, and before Iron


class RecordedTopic(NamedTuple):
    """A topic of a bag.

    Attributes:
        name: Name with leading slash.
        type: ROS type.
        latched: How many messages a late subscriber got from all publishers; 0: not latched.
    """

    name: str
    type: str
    latched: int


class RecordedMessage(NamedTuple):
    """One message of a bag; `log_time` in nanoseconds, `data` as it was recorded."""

    log_time: int
    topic: str
    data: bytes


class _Chunk(NamedTuple):
    """Where a chunk lies; chunks sort by their first log time [ns]."""

    first: int
    rank: int  # place in the order of files and offsets
    last: int
    stream: IO[bytes]
    offset: int
    channels: dict[int, str]  # id to topic


class BagReader:
    """An open bag; holds a few chunks in memory, whatever its size.

    Attributes:
        topics: By name with leading slash.
        counts: Messages by topic.
        start: Log time of the first message [ns].
        end: Log time of the last message [ns].
    """

    def __init__(self, bag: str | Path) -> None:
        """Read the index.

        Args:
            bag: Directory of the bag, or its MCAP file.

        Raises:
            BagError: not a bag, or one without index.
        """
        self.topics: dict[str, RecordedTopic] = {}
        self.counts: Counter[str] = Counter()
        self._streams: list[IO[bytes]] = []
        chunks: list[_Chunk] = []
        for file in files(Path(bag)):
            chunks += self._index(file, len(chunks))
        self._chunks = sorted(chunks)
        self.start = min((chunk.first for chunk in chunks), default=0)
        self.end = max((chunk.last for chunk in chunks), default=0)

    def messages(
        self, topics: Collection[str], start: int, end: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Iterate in the order of log times; equal ones as they lie in the file.

        Args:
            topics: Names with leading slash.
            start: First log time [ns].
            end: Last log time [ns]; None: that of the bag.

        Raises:
            BagError: the file is broken.
        """
        end = self.end if end is None else end
        pending: list[tuple[Any, ...]] = []
        for chunk in self._chunks:
            if chunk.last < start or chunk.first > end:
                continue
            ready = bisect.bisect_left(pending, (chunk.first,))
            yield from map(_message, pending[:ready])
            pending = pending[ready:]
            pending += (item for item in _scan(chunk, topics) if start <= item[0] <= end)
            pending.sort()
        yield from map(_message, pending)

    def latched(self, topics: Collection[str], before: int) -> list[RecordedMessage]:
        """What a subscriber of latched topics would know at a moment [ns], in order.

        Raises:
            BagError: the file is broken.
        """
        wanted = {name: self.topics[name].latched for name in topics if self.topics[name].latched}
        found: list[tuple[Any, ...]] = []
        for chunk in reversed(self._chunks):
            if chunk.first >= before or not wanted.keys() & chunk.channels.values():
                continue
            for item in sorted(_scan(chunk, wanted), reverse=True):
                if item[0] < before and wanted.get(item[3]):
                    wanted[item[3]] -= 1
                    found.append(item)
            wanted = {name: left for name, left in wanted.items() if left}
        return [_message(item) for item in sorted(found)]

    def close(self) -> None:
        """Close the files."""
        for stream in self._streams:
            stream.close()

    def _index(self, file: Path, rank: int) -> list[_Chunk]:
        try:
            stream = file.open('rb')
            self._streams.append(stream)
            summary = make_reader(stream).get_summary()
        except Exception as error:  # in a broken file, any length or string can be wrong
            raise BagError(
                f'{file} cannot be read: it is no MCAP file, or was cut off '
                f'({str(error) or type(error).__name__})'
            ) from None
        statistics = summary.statistics if summary else None
        if summary is None or statistics is None:
            raise BagError(f'{file} has no index: its recording was cut off')
        if statistics.message_count and not summary.chunk_indexes:
            raise BagError(f'{file} has no index: it was written without chunks')
        names = {}
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            if schema is None or channel.message_encoding != 'cdr':
                continue
            names[channel.id] = channel.topic
            latched = _latched(channel.metadata.get('offered_qos_profiles', ''))
            self.topics[channel.topic] = RecordedTopic(channel.topic, schema.name, latched)
            self.counts[channel.topic] += statistics.channel_message_counts.get(channel.id, 0)
        return [
            _Chunk(
                index.message_start_time,
                rank + k,
                index.message_end_time,
                stream,
                index.chunk_start_offset,
                {
                    key: name
                    for key, name in names.items()
                    if key in index.message_index_offsets or not index.message_index_offsets
                },
            )
            for k, index in enumerate(sorted(summary.chunk_indexes, key=_offset))
        ]


def _offset(index: Any) -> int:
    return int(index.chunk_start_offset)


def _scan(chunk: _Chunk, topics: Collection[str]) -> Iterator[tuple[Any, ...]]:
    """Messages of a chunk: log time, rank, offset, topic, bytes of the chunk, end."""
    try:
        chunk.stream.seek(chunk.offset + RECORD.size)
        stream, length = get_chunk_data_stream(Chunk.read(ReadDataStream(chunk.stream)))
        data = stream.read(length)
        position = 0
        while position < length:
            opcode, size = RECORD.unpack_from(data, position)
            position += RECORD.size + size
            if opcode != MESSAGE_OPCODE:
                continue
            key, _, log_time, _ = MESSAGE.unpack_from(data, position - size)
            topic = chunk.channels.get(key)
            if topic in topics:
                first = position - size + MESSAGE.size
                yield log_time, chunk.rank, first, topic, data, position
    except Exception as error:  # in a broken file, any length or string can be wrong
        reason = str(error) or type(error).__name__
        raise BagError(f'{chunk.stream.name} cannot be read: {reason}') from None


def _message(item: tuple[Any, ...]) -> RecordedMessage:
    log_time, _, first, topic, data, end = item
    return RecordedMessage(log_time, topic, data[first:end])


def _latched(profiles: str) -> int:
    """History of all latched publishers together, from `offered_qos_profiles`."""
    try:
        latched = [p for p in yaml.safe_load(profiles) if p['durability'] in TRANSIENT_LOCAL]
        return sum(max(1, min(int(p['depth']), 1000)) for p in latched)
    except (KeyError, TypeError, ValueError, yaml.YAMLError):
        return 0
