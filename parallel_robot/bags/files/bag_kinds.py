"""What a file of a bag is: MCAP, which is scanned; sqlite3, likewise; or what it is instead."""

from __future__ import annotations

import shlex
import shutil
import sqlite3
import tempfile
import weakref
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from parallel_robot.bags.files import mcap_reader
from parallel_robot.bags.files.bag_files import File, release
from parallel_robot.bags.files.mcap_reader import Chunk, ChunkTable, Damage, Record
from parallel_robot.bags.files.mcap_records import (
    MESSAGE,
    MESSAGE_HEAD,
    Block,
)
from parallel_robot.bags.limits import CHANNELS, CHUNK, CHUNK_INDEX, Allowance
from parallel_robot_model.common.errors import BagError

# A sqlite3 file of rosbag2 as records of MCAP.

BATCH = 1 << 20  # bytes of messages that make one block
LAST = (1 << 63) - 1  # log time [ns]
JOURNAL = '-wal'  # what a recorder that was killed has not put into its file
CACHE = 512  # kB of each file that sqlite3 holds
ROWS = 4096  # of what is read like a chunk of MCAP
MESSAGES = 'SELECT topic_id, timestamp, data FROM messages'
CHUNK_ROWS = (
    'SELECT min(r), max(r) FROM '
    '(SELECT rowid AS r FROM messages WHERE rowid > ? ORDER BY rowid LIMIT ?)'
)
TOPICS_OF_CHUNK = f"""
SELECT topic_id, count(*), min(timestamp), max(timestamp), min(r), max(r), max(NOT sound) FROM (
    SELECT rowid AS r, topic_id, timestamp,
        typeof(topic_id) = 'integer' AND topic_id BETWEEN 1 AND 65535
        AND typeof(timestamp) = 'integer' AND timestamp >= 0
        AND typeof(data) = 'blob' AND length(data) < {CHUNK} AS sound
    FROM messages WHERE rowid > ? ORDER BY rowid LIMIT ?
) GROUP BY topic_id"""


def scan_sqlite(path: Path, file: File, skipped: Collection[int] = ()) -> Iterator[Record]:
    """Yield topics and messages in the order in which they were written.

    Args:
        path: The file; nothing is written beside it.
        file: Its content.
        skipped: First rows of the chunks that are not wanted, see :func:`index`.

    Raises:
        BagError: it is no bag, or takes more than is allowed.
    """
    with ExitStack() as stack:
        try:
            bag = _opened(path, file, stack)
            yield from _topics(path, bag)
        except (sqlite3.Error, KeyError) as error:
            raise BagError(f'{path} is no sqlite3 bag: {error}') from None
        try:
            yield from _blocks(_rows(bag, skipped), file.allowance)
        except (sqlite3.Error, OverflowError, TypeError):
            yield Damage('record', 0)


def _index_sqlite(
    path: Path, file: File, chunks: ChunkTable
) -> list[Schema | Channel | Statistics] | None:
    """What the summary of an MCAP file would hold; None where a row is not sound."""
    counts: Counter[int] = Counter()
    with ExitStack() as stack:
        try:
            bag = _opened(path, file, stack)
            described = [*_topics(path, bag)]
            if bag.execute('SELECT 1 FROM messages WHERE rowid < 0 LIMIT 1').fetchone():
                return None
            last = -1
            while found := bag.execute(TOPICS_OF_CHUNK, (last, ROWS)).fetchall():
                topics, numbers, first, newest, begins, ends, unsound = zip(*found, strict=True)
                if any(unsound):
                    return None
                file.allowance.walk(sum(numbers))
                file.allowance.hold(CHUNK_INDEX)
                begin, last = min(begins), max(ends)
                chunks.add(min(first), max(newest), begin, last - begin, topics)
                counts.update(dict(zip(topics, numbers, strict=True)))
        except (sqlite3.Error, KeyError, OverflowError, TypeError):
            return None
    return [*described, Statistics(0, 0, dict(counts), 0, counts.total(), 0, 0, 0, 0)]


class SqliteFile:
    """A file of which parts are read at any times."""

    def __init__(self, path: Path, file: File) -> None:
        """Open it.

        Raises:
            BagError: it cannot be opened.
        """
        stack = ExitStack()
        self.close = weakref.finalize(self, stack.close)
        try:
            self._bag = _opened(path, file, stack)
        except sqlite3.Error as error:
            raise BagError(f'{path} is no sqlite3 bag: {error}') from None

    def blocks(
        self, chunk: Chunk, topics: Collection[int], allowance: Allowance
    ) -> Iterator[Block | Damage]:
        """Messages of a chunk that are of some topics, by their numbers, a megabyte at a time."""
        wanted = ', '.join(str(int(topic)) for topic in topics)
        query = f'{MESSAGES} WHERE rowid BETWEEN ? AND ? AND topic_id IN ({wanted})'
        try:
            rows = self._bag.execute(query, (chunk.offset, chunk.offset + chunk.length))
            yield from _blocks(rows, allowance)
        except (sqlite3.Error, OverflowError, TypeError):
            yield Damage('record', 0)


def _opened(path: Path, file: File, stack: ExitStack) -> sqlite3.Connection:
    """A connection to a file that nothing is written to, or to a copy of it."""
    place, mode = path, 'mode=ro&immutable=1'
    journal = path.with_name(path.name + JOURNAL)
    if path.suffix == '.zstd' or (journal.is_file() and journal.stat().st_size):
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        place, mode = folder / 'bag.db3', 'mode=rw'
        with place.open('wb') as copy:
            copy.write(file.data)
        release(file.data)
        if journal.is_file() and path.suffix != '.zstd':
            shutil.copyfile(journal, folder / f'bag.db3{JOURNAL}')
    uri = f'file:{quote(str(place.resolve()))}?{mode}'
    connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
    bag = stack.enter_context(closing(connection))
    bag.execute('PRAGMA trusted_schema = OFF')
    bag.execute(f'PRAGMA cache_size = -{CACHE}')
    return bag


def _topics(path: Path, bag: sqlite3.Connection) -> Iterator[Schema | Channel]:
    """Topics, with their types; the number of a channel is that of its row."""
    query = "SELECT name FROM sqlite_master WHERE type = 'table'"
    tables = {name for (name,) in bag.execute(query).fetchmany(CHANNELS)}
    if not {'topics', 'messages'} <= tables:
        raise BagError(f'{path} is a sqlite3 file, but no bag: it has no topics and messages')
    rows = bag.execute('SELECT * FROM topics ORDER BY id')
    columns = [name for name, *_ in rows.description]
    for row in rows.fetchmany(CHANNELS):
        topic = dict(zip(columns, row, strict=True))
        number, name, kind = topic['id'], str(topic['name']), str(topic['type'])
        if not (isinstance(number, int) and 0 < number < 1 << 16):
            raise BagError(f'{path} has a topic with the number {number!r:.20}')
        encoding = str(topic.get('serialization_format', 'cdr'))
        profiles = str(topic.get('offered_qos_profiles') or '')
        yield Schema(number, b'', 'ros2msg', kind)
        yield Channel(number, name, encoding, {'offered_qos_profiles': profiles}, number)


def _rows(bag: sqlite3.Connection, skipped: Collection[int]) -> Iterator[tuple[Any, Any, Any]]:
    """Topic, time and data of the messages of all chunks that are not skipped."""
    if not skipped:
        yield from bag.execute(MESSAGES)
        return
    last = -1
    while (span := bag.execute(CHUNK_ROWS, (last, ROWS)).fetchone())[0] is not None:
        if span[0] not in skipped:
            yield from bag.execute(f'{MESSAGES} WHERE rowid BETWEEN ? AND ?', span)
        last = span[1]


def _blocks(
    rows: Iterable[tuple[Any, Any, Any]], allowance: Allowance
) -> Iterator[Block | Damage]:
    """Messages, a megabyte at a time."""
    parts: list[bytes] = []
    starts: list[int] = []
    size = count = 0
    for topic, time, data in rows:
        count += 1
        sound = isinstance(data, bytes) and len(data) < CHUNK
        sound = sound and isinstance(time, int) and 0 <= time <= LAST
        if not (sound and isinstance(topic, int) and 0 < topic < 1 << 16):
            yield Damage('record', 0)
            continue
        allowance.walk(1)
        allowance.unpack(len(data))
        head = (Opcode.MESSAGE, MESSAGE_HEAD + len(data), topic, count & 0xFFFFFFFF, time, time)
        parts += MESSAGE.pack(*head), data
        starts.append(size)
        size += MESSAGE.size + len(data)
        if size > BATCH:
            yield _block(parts, starts)
            parts, starts, size = [], [], 0
    if starts:
        yield _block(parts, starts)


def _block(parts: list[bytes], starts: list[int]) -> Block:
    return Block(memoryview(b''.join(parts)), np.array(starts))


SQLITE = b'SQLite format 3\0'
POINTER = b'version https://git-lfs.github.com/spec/'
ROS1 = b'#ROSBAG V'
PACKERS = {
    b'\x1f\x8b': 'gzip',
    b'BZh': 'bzip2',
    b'\xfd7zXZ\0': 'xz',
    b'PK\3\4': 'zip',
    b"7z\xbc\xaf'\x1c": '7z',
}
HEADER = 4096  # bytes that hold its header
INDEXED = b'index_pos='  # of the header, before the place of the index
NO_INDEX = INDEXED + bytes(8)


def records(path: Path, file: File, skipped: Collection[int] = ()) -> Iterator[Record]:
    """What a file of a bag holds, as records of MCAP.

    Args:
        path: Its path, for what is beside it, and for error messages.
        file: Its content.
        skipped: Where chunks begin that are not wanted.

    Raises:
        BagError: it is of a kind that is not read, it cannot be read, or takes too much.
    """
    if is_sqlite(file):
        return scan_sqlite(path, file, skipped)
    check(path, file)
    return mcap_reader.scan(*file, skipped)


def is_sqlite(file: File) -> bool:
    """Whether a file is one of sqlite3."""
    return file.data[: len(SQLITE)] == SQLITE


def index(path: Path, file: File) -> tuple[list[Any], ChunkTable] | None:
    """What the summary of a file without one would hold; None where more is wrong with it.

    Args:
        path: Its path, for what is beside it, and for error messages.
        file: Its content.

    Raises:
        BagError: it takes too much.
    """
    chunks = ChunkTable()
    if is_sqlite(file):
        found = _index_sqlite(path, file, chunks)
    else:
        found = mcap_reader.index(*file, chunks)
    return None if found is None else (found, chunks)


def check(path: Path, file: File) -> None:
    """Refuse a file of another kind than MCAP, with what helps.

    Raises:
        BagError: it is one.
    """
    begin = bytes(file.data[:64])
    if begin.startswith(SQLITE):
        what = 'is a sqlite3 bag, which has no index'
        raise BagError(f'{path} {what}; parallel_robot recover makes an MCAP bag of it')
    if begin.startswith(POINTER):
        what = 'is a pointer of Git LFS in place of the bag'
        raise BagError(f'{path} {what}: git lfs pull, in its repository, gets the bag')
    if begin.startswith(ROS1):
        if INDEXED not in bytes(file.data[:HEADER]) or NO_INDEX in bytes(file.data[:HEADER]):
            what = 'is a bag of ROS 1 without its index'
            raise BagError(f'{path} {what}: rosbag reindex, of ROS 1, first makes it')
        source, new = shlex.quote(str(path)), shlex.quote(f'{path.with_suffix("").name}_ros2')
        convert = f'rosbags-convert --src {source} --dst {new} --dst-storage mcap'
        raise BagError(f'{path} is a bag of ROS 1: {convert} makes one that is read')
    if not begin:
        raise BagError(f'{path} is empty')
    for first, packer in PACKERS.items():
        if begin.startswith(first):
            raise BagError(f'{path} is packed by {packer}: unpack it first')
    if path.name == 'metadata.yaml':
        raise BagError(f'{path} says what a bag holds: give its directory, {path.parent}')
