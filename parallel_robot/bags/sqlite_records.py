"""A sqlite3 file of rosbag2 as records of MCAP."""

from __future__ import annotations

import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from urllib.parse import quote

import numpy as np
from mcap.records import Channel, Schema

from parallel_robot.bags.bag_files import File
from parallel_robot.bags.limits import CHANNELS, CHUNK
from parallel_robot.bags.mcap_block import HEAD, MESSAGE_HEAD, Block
from parallel_robot.bags.mcap_records import Damage, Record
from parallel_robot_model.common.errors import BagError

BATCH = 1 << 20  # bytes of messages that make one block
OPCODE = 5  # of a message
MESSAGE = struct.Struct('<BQHIQQ')
LAST = (1 << 63) - 1  # log time [ns]
JOURNAL = '-wal'  # what a recorder that was killed has not put into its file


def scan(path: Path, file: File) -> Iterator[Record]:
    """Yield topics and messages in the order in which they were written.

    Args:
        path: The file; nothing is written beside it.
        file: Its content.

    Raises:
        BagError: it is no bag, or takes more than is allowed.
    """
    with ExitStack() as stack:
        place, mode = path, 'mode=ro&immutable=1'
        journal = path.with_name(path.name + JOURNAL)
        if path.suffix == '.zstd' or (journal.is_file() and journal.stat().st_size):
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            place, mode = folder / 'bag.db3', 'mode=rw'
            with place.open('wb') as copy:
                copy.write(file.data)
            if journal.is_file() and path.suffix != '.zstd':
                shutil.copyfile(journal, folder / f'bag.db3{JOURNAL}')
        uri = f'file:{quote(str(place.resolve()))}?{mode}'
        try:
            bag = stack.enter_context(closing(sqlite3.connect(uri, uri=True)))
            bag.execute('PRAGMA trusted_schema = OFF')
            yield from _topics(path, bag)
        except (sqlite3.Error, KeyError) as error:
            raise BagError(f'{path} is no sqlite3 bag: {error}') from None
        try:
            yield from _messages(bag, file)
        except (sqlite3.Error, OverflowError, TypeError):
            yield Damage('record', 0)


def _topics(path: Path, bag: sqlite3.Connection) -> Iterator[Record]:
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


def _messages(bag: sqlite3.Connection, file: File) -> Iterator[Record]:
    """Messages, a megabyte at a time."""
    parts: list[bytes] = []
    starts: list[int] = []
    size = count = 0
    for topic, time, data in bag.execute('SELECT topic_id, timestamp, data FROM messages'):
        count += 1
        sound = isinstance(data, bytes) and len(data) < CHUNK and 0 <= time <= LAST
        if not (sound and 0 < topic < 1 << 16):
            yield Damage('record', 0)
            continue
        file.allowance.walk(1)
        file.allowance.unpack(len(data))
        head = (OPCODE, MESSAGE_HEAD + len(data), topic, count & 0xFFFFFFFF, time, time)
        parts += MESSAGE.pack(*head), data
        starts.append(size)
        size += HEAD + MESSAGE_HEAD + len(data)
        if size > BATCH:
            yield _block(parts, starts)
            parts, starts, size = [], [], 0
    if starts:
        yield _block(parts, starts)


def _block(parts: list[bytes], starts: list[int]) -> Block:
    return Block(memoryview(b''.join(parts)), np.array(starts))
