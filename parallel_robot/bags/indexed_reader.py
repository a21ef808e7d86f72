"""Reads bags of any size piece by piece: in the order of log times, from any moment on."""

from __future__ import annotations

import bisect
import functools
import itertools
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel, Schema, Statistics

from parallel_robot.bags.bag_reader import LARGE, Messages, join, messages_of
from parallel_robot.bags.files import bag_kinds, mcap_reader
from parallel_robot.bags.files.bag_files import File, files, open_file, release
from parallel_robot.bags.files.bag_kinds import JOURNAL, SqliteFile
from parallel_robot.bags.files.mcap_reader import Chunk, Chunks, ChunkTable, Damage
from parallel_robot.bags.files.mcap_records import Block
from parallel_robot.bags.limits import COPIES, MEMORY, Allowance
from parallel_robot.bags.messages.message_arrays import FIRST, LAST, Samples, Span
from parallel_robot.bags.output import MAX_LINE_LENGTH
from parallel_robot_model.common.errors import BagError, WholeNeededError, printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.messages.topics import JOINT_STATES, Topic

TRANSIENT_LOCAL = ('transient_local', 1)  # in bags since Iron, and before
TOPIC = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)  # what ROS allows
TYPE = re.compile(r'[A-Za-z]\w*/(\w+/)?\w+', re.ASCII)
LATEST_TIME = 1 << 61  # ns, largest log time that is accepted
HELP = 'parallel_robot recover makes a whole bag of it'


class RecordedTopic(NamedTuple):
    """A topic of a bag."""

    name: str  # name with leading slash
    type: str  # ROS type
    latched: int  # how many messages a late subscriber got from all publishers; 0: not latched


class RecordedMessage(NamedTuple):
    """One message of a bag; `log_time` in nanoseconds, `data` as it was recorded."""

    log_time: int
    topic: str
    data: bytes


class BagReader:
    """An open bag; holds a few chunks in memory, whatever its size."""

    def __init__(self, bag: str | Path, memory: int = MEMORY, make_index: bool = False) -> None:
        """Read the index.

        Args:
            bag: Directory of the bag, or its MCAP file.
            memory: What may be held of it at once [bytes].
            make_index: Whether one without an index is walked through for it: one that was not
                closed, or of sqlite3, for :meth:`arrays` alone.

        Raises:
            BagError: not a bag, or one without index.
        """
        self.topics: dict[str, RecordedTopic] = {}  # by name with leading slash
        self.counts: Counter[str] = Counter()  # messages by topic
        self._bag = Path(bag)
        self._memory = memory
        self._size = 0
        self._make_index = make_index
        self._walked: set[int] = set()  # files without an index of their own
        self.damage: list[Damage] = []  # what :meth:`arrays` left out
        self._paths = files(self._bag)
        self._names: list[dict[int, str]] = []  # of topics, by number of channel, of each file
        self._data: list[memoryview] = []
        self._sqlite: list[SqliteFile | None] = []
        tables: list[ChunkTable] = []
        for path in self._paths:
            file = open_file(path, memory)
            self._size += len(file.data)
            tables.append(self._index(path, file))
            self._data.append(file.data)
            sqlite = make_index and bag_kinds.is_sqlite(file)
            self._sqlite.append(SqliteFile(path, file) if sqlite else None)
        self._chunks = Chunks(tables)
        # log time of the first message [ns]
        self.start = self._chunks[0].first if len(self._chunks) else 0
        self.end = int(self._chunks.last.max(initial=0))  # log time of the last message [ns]

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
                item for item in self._scan(chunk, topics, allowance) if start <= item[0] <= end
            )
            pending.sort()
            release(self._data[chunk.file])
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
        places = np.flatnonzero(self._chunks.last >= start)
        blocks: list[Block] = []
        for place, next_place in itertools.zip_longest(places, places[1:]):
            chunk, large = self._chunks[int(place)], False
            after = None if next_place is None else self._chunks[int(next_place)]
            wanted = {
                key: (name, topics[name])
                for key, name in self._names[chunk.file].items()
                if name in topics
            }
            for block in self._blocks(chunk, wanted, allowance):
                if isinstance(block, Damage):
                    self.damage.append(block)
                else:
                    blocks.append(block)
                if sum(len(block.data) for block in blocks) > LARGE:
                    yield _named(blocks, wanted, allowance), chunk.first
                    blocks, large = [], True
            if after is None or after.file != chunk.file or large:
                yield _named(blocks, wanted, allowance), after and after.first
                blocks = []
                release(self._data[chunk.file])

    def without(self, topics: Collection[str]) -> dict[Path, set[int]]:
        """Where chunks begin that hold none of some topics, by file.

        Those of a file without summary are not told: they alone say what its topics are.
        """
        found: dict[Path, set[int]] = {}
        for chunk in self._chunks:
            if chunk.file not in self._walked and not self._wanted(chunk, topics):
                found.setdefault(self._paths[chunk.file], set()).add(chunk.offset)
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
            if chunk.first >= before or not self._wanted(chunk, wanted):
                continue
            for item in sorted(self._scan(chunk, wanted, allowance), reverse=True):
                if item[0] < before and wanted.get(item[3]):
                    wanted[item[3]] -= 1
                    found.append(item)
            wanted = {name: left for name, left in wanted.items() if left}
        return [_message(item) for item in sorted(found)]

    def close(self) -> None:
        """Release the files."""
        self._chunks, self._data = Chunks([]), []
        for sqlite in filter(None, self._sqlite):
            sqlite.close()

    def _wanted(self, chunk: Chunk, topics: Collection[str]) -> list[int]:
        """Numbers of the channels of a chunk that are of some topics."""
        names = self._names[chunk.file]
        return [key for key in chunk.channels or names if names.get(key) in topics]

    def _blocks(
        self, chunk: Chunk, wanted: Collection[int], allowance: Allowance
    ) -> Iterator[Block | Damage]:
        """Messages of a chunk, at least those of some channels, by their numbers."""
        sqlite = self._sqlite[chunk.file]
        if sqlite is not None:
            yield from sqlite.blocks(chunk, wanted, allowance)
            return
        block = mcap_reader.messages_at(self._data[chunk.file], chunk.offset, allowance)
        yield Damage('chunk', chunk.length) if block is None else block

    def _scan(
        self, chunk: Chunk, topics: Collection[str], allowance: Allowance
    ) -> Iterator[tuple[Any, ...]]:
        """Messages of a chunk: log time, place, offset, topic, bytes of the chunk, end."""
        block = mcap_reader.messages_at(self._data[chunk.file], chunk.offset, allowance)
        if block is None:
            path = printable(self._paths[chunk.file], MAX_LINE_LENGTH)
            raise BagError(f'{path} cannot be read: a chunk is broken')
        content, names = bytes(block.data), self._names[chunk.file]
        place = chunk.file, chunk.offset
        for channel, _, log_time, _, begin, end in block.rows(self._wanted(chunk, topics)):
            yield log_time, place, begin, names[channel], content, end

    def _index(self, path: Path, file: File) -> ChunkTable:
        name = printable(path, MAX_LINE_LENGTH)
        sqlite = bag_kinds.is_sqlite(file)
        if not (sqlite and self._make_index):
            bag_kinds.check(path, file)
        chunks = ChunkTable()
        end, records = (None, []) if sqlite else mcap_reader.summarised(*file, chunks)
        if end is None and self._make_index:
            walked = _index_of(path, self._memory)
            if walked is not None:
                end, (records, chunks) = len(file.data), walked
                if not sqlite:
                    self._walked.add(len(self._names))
        if end is None:
            raise BagError(f'{name} cannot be read: it is no MCAP file, or was cut off; {HELP}')
        statistics = next((r for r in records if isinstance(r, Statistics)), None)
        if statistics is None:
            raise BagError(f'{name} has no index: its recording was cut off; {HELP}')
        if statistics.message_count and not len(chunks):
            raise BagError(f'{name} has no index: it was written without chunks; {HELP}')
        if int(chunks.numbers()[:, 1].max(initial=0)) > LATEST_TIME:
            raise BagError(f'{name} has log times that no clock can have')
        schemas = {r.id: r.name for r in records if isinstance(r, Schema)}
        topic_of: dict[int, str] = {}
        for channel in (r for r in records if isinstance(r, Channel)):
            full = f'/{channel.topic.lstrip("/")}'  # channels with and without it are one topic
            type_name = schemas.get(channel.schema_id, '')
            known = TYPE.fullmatch(type_name) and TOPIC.fullmatch(full)
            if not known or channel.message_encoding != 'cdr':
                continue
            topic_of[channel.id] = full
            latched = _latched(channel.metadata.get('offered_qos_profiles', ''))
            self.topics[full] = RecordedTopic(full, type_name, latched)
            self.counts[full] += statistics.channel_message_counts.get(channel.id, 0)
        self._names.append(topic_of)
        return chunks


def _index_of(path: Path, memory: int) -> tuple[list[Any], ChunkTable] | None:
    """Index of a file without one, see :func:`bag_kinds.index`."""
    try:
        states = [path.stat()]
        journal = path.with_name(path.name + JOURNAL)
        states += [journal.stat()] if journal.is_file() else []
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error.strerror}') from None
    state = tuple((each.st_ino, each.st_size, each.st_mtime_ns) for each in states)
    return _walked(path, state, memory)


@functools.lru_cache(maxsize=4)
def _walked(
    path: Path, _state: tuple[tuple[int, ...], ...], memory: int
) -> tuple[list[Any], ChunkTable] | None:
    """The same; while the file stays as it is, it is walked through once."""
    return bag_kinds.index(path, open_file(path, memory))


def _named(
    blocks: Sequence[Block], wanted: Mapping[int, tuple[str, Topic]], allowance: Allowance
) -> list[tuple[str, Messages]]:
    """Messages of some blocks by the names of their topics."""
    found = messages_of(join(blocks), wanted, allowance) if blocks else ()
    return [(wanted[key][0], part) for key, part in found]


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


# The messages of a bag in windows of time, in memory that does not grow with the bag.

SLACK = 2 * NANOSECONDS  # ns, by which messages may be logged after states that are newer

Streams = dict[str, list[Samples]]  # by full name of the topic


class Window(NamedTuple):
    """The messages of a window, and those around it that its states need."""

    span: Span  # the window
    streams: Mapping[str, Sequence[Sequence[Samples]]]  # the messages
    preceded: bool  # whether states from before it were read


def windows(
    bag: Path,
    source: Iterable[tuple[list[tuple[str, list[Samples]]], int | None]],
    topics: Mapping[str, Topic],
    begin: int,
    end_of: Callable[[int], int],
    around: int,
    memory: int,
) -> Iterator[Window]:
    """Iterate over windows that follow each other, by the stamps of the states.

    Messages without a stamp belong to a window by their log times: from that of its first state
    to that of the first state after it. A window without states is one with the next.

    Args:
        bag: The bag, for error messages.
        source: Messages, and the log time up to which all are there by then; None: all.
        topics: Topics by their full names.
        begin: Stamp at which the first window begins [ns].
        end_of: Stamp at which the window of a state ends, by its stamp [ns].
        around: How much before and after a window is needed for it [ns].
        memory: What may be held [bytes].

    Raises:
        BagError: a window takes too much.
        WholeNeededError: the stamps of the states go back beyond it.
    """
    pending: Streams = {}
    span = Span(FIRST, FIRST, FIRST, FIRST)
    for parts, known in source:
        for name, samples in parts:
            late = any((part.stamps < span.end).any() for part in samples)
            if topics[name] == JOINT_STATES and late:
                what = f'the stamps of {JOINT_STATES.name} go back, as in a second run'
                raise WholeNeededError(f'{bag}: {what}: it can be read as a whole alone')
            pending.setdefault(name, []).extend(samples)
        Allowance(bag, 0, memory).hold(_size(pending))
        while found := _span(pending, topics, max(begin, span.end), span.end_heard, end_of, known):
            span = found
            yield _window(pending, topics, span, around)


def _span(
    pending: Streams,
    topics: Mapping[str, Topic],
    begin: int,
    heard: int,
    end_of: Callable[[int], int],
    known: int | None,
) -> Span | None:
    """The window that begins at a stamp, if all of it is there by now; `heard` of the last one."""
    states = [
        part for name, parts in pending.items() for part in parts if topics[name] == JOINT_STATES
    ]
    if not any((part.stamps >= begin).any() for part in states):
        return None
    stamps = np.concatenate([part.stamps for part in states])
    times = np.concatenate([part.log_times for part in states])
    end = end_of(int(stamps[stamps >= begin].min()))
    inside, after = times[(stamps >= begin) & (stamps < end)], times[stamps >= end]
    if not inside.size or (
        known is not None and not (after.size and known >= after.min() + SLACK)
    ):
        return None
    if begin > FIRST and heard == FIRST:
        heard = int(inside.min())
    return Span(begin, end, heard, int(after.min())) if after.size else Span(begin, LAST, heard)


def _window(pending: Streams, topics: Mapping[str, Topic], span: Span, around: int) -> Window:
    """A window; what it and those after it do not need is given up."""
    preceded = False
    for name, parts in pending.items():
        if topics[name] == JOINT_STATES:
            preceded |= any((part.stamps < span.begin).any() for part in parts)
        low = span.begin - around
        older = [part.stamps[part.stamps <= low] for part in parts]
        low = max(
            (int(each.max()) for each in older if each.size), default=low
        )  # the last of them
        since = Span(low, LAST, span.begin_heard - SLACK, LAST)
        pending[name] = _chosen(topics[name], parts, since)
    until = Span(FIRST, span.end + around, FIRST, span.end_heard + SLACK)
    chosen = {name: _chosen(topics[name], parts, until) for name, parts in pending.items()}
    streams = {name: [parts] for name, parts in chosen.items() if parts}
    return Window(span, streams, preceded)


def _chosen(topic: Topic, parts: list[Samples], span: Span) -> list[Samples]:
    """Messages of a part of a run."""
    chosen = []
    for part in parts:
        kept = span.holds(topic, part)
        if kept.all():
            chosen.append(part)
        elif kept.any():
            chosen.append(part.rows(kept))
    return chosen


def _size(pending: Streams) -> int:
    """Bytes of messages."""
    parts = [part for parts in pending.values() for part in parts]
    return sum(
        part.stamps.nbytes + sum(values.nbytes for values in part.numbers.values())
        for part in parts
    )
