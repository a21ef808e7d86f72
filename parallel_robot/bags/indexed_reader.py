"""Reads bags of any size piece by piece: in the order of log times, from any moment on."""

from __future__ import annotations

import bisect
import functools
import itertools
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from parallel_robot.bags import bag_kinds, mcap_records
from parallel_robot.bags.bag_files import File, files, open_file, release
from parallel_robot.bags.bag_reader import LARGE, Messages, join, messages_of
from parallel_robot.bags.limits import COPIES, MEMORY, Allowance
from parallel_robot.bags.mcap_block import Block
from parallel_robot.bags.mcap_records import Damage
from parallel_robot.bags.printable_output import MAX_LINE_LENGTH
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.messages.topics import Topic

TRANSIENT_LOCAL = ('transient_local', 1)  # in bags since Iron, and before
TOPIC = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)  # what ROS allows
TYPE = re.compile(r'[A-Za-z]\w*/(\w+/)?\w+', re.ASCII)
LAST = 1 << 61  # ns, largest log time that is accepted
HELP = 'parallel_robot recover makes a whole bag of it'
INDEX = mcap_records.SUMMARISED | {Opcode.CHUNK_INDEX: ChunkIndex}


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
    path: Path
    data: memoryview
    offset: int
    length: int
    channels: dict[int, str]  # id to topic


class BagReader:
    """An open bag; holds a few chunks in memory, whatever its size.

    Attributes:
        topics: By name with leading slash.
        counts: Messages by topic.
        start: Log time of the first message [ns].
        end: Log time of the last message [ns].
        damage: What :meth:`arrays` left out.
    """

    def __init__(self, bag: str | Path, memory: int = MEMORY, unclosed: bool = False) -> None:
        """Read the index.

        Args:
            bag: Directory of the bag, or its MCAP file.
            memory: What may be held of it at once [bytes].
            unclosed: Whether one that was not closed is walked through for its index.

        Raises:
            BagError: not a bag, or one without index.
        """
        self.topics: dict[str, RecordedTopic] = {}
        self.counts: Counter[str] = Counter()
        self._bag = Path(bag)
        self._memory = memory
        self._size = 0
        self._unclosed = unclosed
        self._walked: set[Path] = set()  # files without an index of their own
        self.damage: list[Damage] = []
        self._names: dict[Path, dict[int, str]] = {}  # of topics, by number of channel
        chunks: list[_Chunk] = []
        for path in files(self._bag):
            file = open_file(path, memory)
            self._size += len(file.data)
            chunks += self._index(path, file, len(chunks))
        self._chunks = sorted(chunks)  # by time and rank, which is unique
        self.start = min((chunk.first for chunk in chunks), default=0)
        self.end = max((chunk.last for chunk in chunks), default=0)

    def messages(
        self, topics: Collection[str], start: int, end: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Iterate in the order of log times; equal ones in the order of the file.

        Args:
            topics: Names with leading slash.
            start: First log time [ns].
            end: Last log time [ns]; None: that of the bag.

        Raises:
            BagError: the file is broken, or takes too much.
        """
        end = self.end if end is None else end
        allowance = Allowance(self._bag, self._size, self._memory)
        pending: list[tuple[Any, ...]] = []
        for chunk in self._chunks:
            if chunk.last < start or chunk.first > end:
                continue
            ready = bisect.bisect_left(pending, (chunk.first,))
            yield from map(_message, pending[:ready])
            pending = pending[ready:]
            held = {item[1]: len(item[4]) for item in pending}
            if sum(held.values()) > self._memory // COPIES:
                raise BagError(f'{self._bag}: too many chunks are of the same time')
            pending += (
                item for item in _scan(chunk, topics, allowance) if start <= item[0] <= end
            )
            pending.sort()
            release(chunk.data)
        yield from map(_message, pending)

    def arrays(
        self, topics: Mapping[str, Topic], start: int = 0
    ) -> Iterator[tuple[list[tuple[str, Messages]], int | None]]:
        """Iterate over messages as arrays, about in the order of log times; leaves out damage.

        Args:
            topics: Topics by their names with leading slash.
            start: First log time [ns]; some messages from before come with it.

        Yields:
            Some megabytes of messages by the names of their topics, and the log time up to which
            all are read by now [ns]; None: all of the bag.

        Raises:
            BagError: it takes too much.
        """
        allowance = Allowance(self._bag, self._size, self._memory)
        chunks = [chunk for chunk in self._chunks if chunk.last >= start]
        blocks: list[Block] = []
        for chunk, after in itertools.zip_longest(chunks, chunks[1:]):
            block = mcap_records.messages_at(chunk.data, chunk.offset, allowance)
            if block is None:
                self.damage.append(Damage('chunk', chunk.length))
            else:
                blocks.append(block)
            large = sum(len(block.data) for block in blocks) > LARGE
            if after is None or after.path != chunk.path or large:
                wanted = {
                    key: (name, topics[name])
                    for key, name in self._names[chunk.path].items()
                    if name in topics
                }
                found = messages_of(join(blocks), wanted, allowance) if blocks else ()
                yield [(wanted[key][0], part) for key, part in found], after and after.first
                blocks = []
                release(chunk.data)

    def without(self, topics: Collection[str]) -> dict[Path, set[int]]:
        """Where chunks begin that hold none of some topics, by file.

        Those of a file without summary are not told: they alone say what its topics are.
        """
        found: dict[Path, set[int]] = {}
        for chunk in self._chunks:
            if chunk.path not in self._walked and not {*topics} & {*chunk.channels.values()}:
                found.setdefault(chunk.path, set()).add(chunk.offset)
        return found

    def latched(self, topics: Collection[str], before: int) -> list[RecordedMessage]:
        """Messages that a new subscriber of latched topics would get at a moment [ns], in order.

        Raises:
            BagError: the file is broken, or takes too much.
        """
        allowance = Allowance(self._bag, self._size, self._memory)
        wanted = {name: self.topics[name].latched for name in topics if self.topics[name].latched}
        found: list[tuple[Any, ...]] = []
        for chunk in reversed(self._chunks):
            if chunk.first >= before or not wanted.keys() & chunk.channels.values():
                continue
            for item in sorted(_scan(chunk, wanted, allowance), reverse=True):
                if item[0] < before and wanted.get(item[3]):
                    wanted[item[3]] -= 1
                    found.append(item)
            wanted = {name: left for name, left in wanted.items() if left}
        return [_message(item) for item in sorted(found)]

    def close(self) -> None:
        """Release the files."""
        self._chunks = []

    def _index(self, path: Path, file: File, rank: int) -> list[_Chunk]:
        name = printable(path, MAX_LINE_LENGTH)
        bag_kinds.check(path, file)
        end, records = mcap_records.summarised(*file, INDEX)
        if end is None and self._unclosed:
            walked = _index_of(path, self._memory)
            if walked is not None:
                end, records = len(file.data), walked
                self._walked.add(path)
        if end is None:
            raise BagError(f'{name} cannot be read: it is no MCAP file, or was cut off; {HELP}')
        statistics = next((r for r in records if isinstance(r, Statistics)), None)
        indexes = {r.chunk_start_offset: r for r in records if isinstance(r, ChunkIndex)}
        if statistics is None:
            raise BagError(f'{name} has no index: its recording was cut off; {HELP}')
        if statistics.message_count and not indexes:
            raise BagError(f'{name} has no index: it was written without chunks; {HELP}')
        if max((index.message_end_time for index in indexes.values()), default=0) > LAST:
            raise BagError(f'{name} has log times that no clock can have')
        schemas = {r.id: r.name for r in records if isinstance(r, Schema)}
        topic_of = self._names.setdefault(path, {})
        for channel in (r for r in records if isinstance(r, Channel)):
            type_name = schemas.get(channel.schema_id, '')
            known = TYPE.fullmatch(type_name) and TOPIC.fullmatch(channel.topic)
            if not known or channel.message_encoding != 'cdr':
                continue
            topic_of[channel.id] = channel.topic
            latched = _latched(channel.metadata.get('offered_qos_profiles', ''))
            self.topics[channel.topic] = RecordedTopic(channel.topic, type_name, latched)
            self.counts[channel.topic] += statistics.channel_message_counts.get(channel.id, 0)
        alike: dict[tuple[int, ...], dict[int, str]] = {}  # of many chunks, once

        def topics(index: ChunkIndex) -> dict[int, str]:
            there = tuple(index.message_index_offsets or topic_of)
            if there not in alike:
                alike[there] = {key: topic_of[key] for key in there if key in topic_of}
            return alike[there]

        return [
            _Chunk(
                index.message_start_time,
                rank + k,
                index.message_end_time,
                path,
                file.data,
                offset,
                index.chunk_length,
                topics(index),
            )
            for k, (offset, index) in enumerate(sorted(indexes.items()))
        ]


def _index_of(path: Path, memory: int) -> list[Any] | None:
    """Index of a file that was not closed, see :func:`mcap_records.index`."""
    try:
        state = path.stat()
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error.strerror}') from None
    return _walked(path, (state.st_ino, state.st_size, state.st_mtime_ns), memory)


@functools.lru_cache(maxsize=4)
def _walked(path: Path, _state: tuple[int, ...], memory: int) -> list[Any] | None:
    """The same; while the file stays as it is, it is walked through once."""
    return mcap_records.index(*open_file(path, memory))


def _scan(
    chunk: _Chunk, topics: Collection[str], allowance: Allowance
) -> Iterator[tuple[Any, ...]]:
    """Messages of a chunk: log time, rank, offset, topic, bytes of the chunk, end."""
    block = mcap_records.messages_at(chunk.data, chunk.offset, allowance)
    if block is None:
        raise BagError(
            f'{printable(chunk.path, MAX_LINE_LENGTH)} cannot be read: a chunk is broken'
        )
    content = bytes(block.data)
    wanted = [key for key, topic in chunk.channels.items() if topic in topics]
    for channel, _, log_time, _, begin, end in block.rows(wanted):
        yield log_time, chunk.rank, begin, chunk.channels[channel], content, end


def _message(item: tuple[Any, ...]) -> RecordedMessage:
    log_time, _, first, topic, data, end = item
    return RecordedMessage(log_time, topic, data[first:end])


def _latched(profiles: str) -> int:
    """History of all latched publishers together, from `offered_qos_profiles`."""
    try:
        latched = [p for p in plain_data.load(profiles) if p['durability'] in TRANSIENT_LOCAL]
        return sum(max(1, min(int(p['depth']), 1000)) for p in latched)
    except (KeyError, TypeError, ValueError):
        return 0
