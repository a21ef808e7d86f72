"""Messages of a bag as arrays of bytes, whoever recorded it and however it ended."""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Generic, NamedTuple, TypeVar

import numpy as np
import zstandard
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from parallel_robot_bags import limits, plain_data
from parallel_robot_bags.bag_writer import LAWS, METADATA
from parallel_robot_bags.limits import (
    CHANNELS,
    CHUNK,
    LAW,
    LENGTHS,
    MEMORY,
    NAME,
    RATIO,
    YAML,
    Allowance,
)
from parallel_robot_bags.mcap_records import HEAD, MESSAGE_HEAD, Block, Damage, Record, plain, scan
from parallel_robot_base.errors import BagError
from parallel_robot_base.topics import Topic

Part = TypeVar('Part')

LARGE = 1 << 21  # bytes of messages that are sorted at once
PIECE = 1 << 20  # bytes that are unpacked at once


class File(NamedTuple):
    """Content of an MCAP file, and what reading it may take."""

    data: memoryview
    allowance: Allowance


class Messages(NamedTuple):
    """Some messages of one topic and one length, in the order of the file.

    Attributes:
        log_times: When they were recorded [ns], shape (N,).
        payloads: The bytes, shape (N, L).
    """

    log_times: np.ndarray
    payloads: np.ndarray


@dataclass(frozen=True)
class Bag(Generic[Part]):
    """What was asked of a bag.

    Attributes:
        streams: What was made of the messages, by full name of the topic.
        metadata: What the suite wrote about the experiment; empty when another recorded it.
        warnings: What is wrong with the bag, one line each.
        notes: Other metadata records, by their name.
        laws: Name to source of the laws of one's own; what is no name or too long is left out.
    """

    streams: dict[str, list[Part]]
    metadata: dict[str, str]
    warnings: tuple[str, ...]
    notes: dict[str, list[dict[str, str]]]
    laws: dict[str, bytes]


def read(
    bag: str | Path,
    topics: Iterable[Topic],
    condense: Callable[[Topic, Messages], Part],
    memory: int = MEMORY,
) -> Bag[Part]:
    """Read some topics of a bag, some megabytes at a time.

    Args:
        bag: Directory of the bag, or one file of it.
        topics: What to read, in any namespace, where the type is the same or not known.
        condense: Makes of some messages what is kept of them, which is not more.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: nothing there is an MCAP file, or it takes more than is allowed.
    """
    bag = Path(bag)
    streams: dict[str, list[Part]] = {}
    facts: dict[str, str] = {}
    notes: dict[str, list[dict[str, str]]] = {}
    laws: dict[str, bytes] = {}
    damage: list[Damage] = []
    understood = False
    held = Allowance(bag, 0, memory)
    for file in files(bag):
        schemas: dict[int, str] = {}
        wanted: dict[int, tuple[str, Topic]] = {}
        opened = open_file(file, memory)
        for record in _joined(scan(*opened)):
            understood = understood or not isinstance(record, (Damage, Header))
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                name = f'/{record.topic.lstrip("/")}'
                for topic in topics:
                    same = schemas.get(record.schema_id, '') in (topic.type, '')
                    if same and name.endswith(f'/{topic.name}'):
                        wanted[record.id] = name, topic
                if len(wanted) > CHANNELS:
                    raise BagError(f'{file} has more than {CHANNELS} channels of such topics')
            elif isinstance(record, Metadata) and record.name == METADATA:
                facts = record.metadata
            elif isinstance(record, Metadata) and record.name.startswith(METADATA):
                held.hold(sum(len(text) for pair in record.metadata.items() for text in pair))
                notes.setdefault(record.name, []).append(record.metadata)
            elif isinstance(record, Attachment) and record.name.startswith(LAWS):
                law = record.name.removeprefix(LAWS)
                if law.isidentifier() and len(law.encode()) <= NAME and len(record.data) <= LAW:
                    held.hold(len(record.data))
                    laws[law] = record.data
                if len(laws) > limits.LAWS:
                    raise BagError(f'{file} holds more than {limits.LAWS} laws')
            elif isinstance(record, Damage):
                damage.append(record)
            elif isinstance(record, Block):
                for channel, messages in _messages(record, wanted, opened.allowance):
                    held.hold(messages.payloads.nbytes)
                    name, topic = wanted[channel]
                    streams.setdefault(name, []).append(condense(topic, messages))
    if not understood:
        raise BagError(f'{bag} cannot be read: nothing in it is MCAP')
    if damage or not facts:
        facts = custom_data(bag) or facts
    if plain_data.whole_number(facts.get('start_stamp', '0')) is None:
        raise BagError(f'{bag}: its start_stamp must be a whole number of nanoseconds')
    warnings = (warning(bag, damage),) if damage else ()
    return Bag(streams, facts, warnings, notes, laws)


def files(bag: Path) -> list[Path]:
    """The MCAP files of a bag, in the order of recording.

    Raises:
        BagError: there is none.
    """
    try:
        names = {path.name for path in bag.iterdir()} if bag.is_dir() else set()
        there = bag.is_file()
        exists = bag.exists()
    except OSError as error:
        raise BagError(f'{bag} cannot be read: {error.strerror}') from None
    packed = {name for name in names if name.endswith('.mcap.zstd') and name[:-5] not in names}
    unpacked = {name for name in names if name.endswith('.mcap')}
    paths = [bag / name for name in sorted(packed | unpacked, key=_numbers_by_value)]
    paths = [bag] if there else paths
    if not exists:
        raise BagError(f'{bag} does not exist')
    if not paths:
        raise BagError(f'{bag} is not a bag: no MCAP file there')
    return paths


def open_file(path: Path, memory: int = MEMORY) -> File:
    """Open an MCAP file; it is mapped rather than loaded, and unpacked if it is packed as a whole.

    Args:
        path: The file.
        memory: What may be held of it [bytes].

    Raises:
        BagError: it cannot be read, or takes more than is allowed.
    """
    try:
        with _regular(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            allowance = Allowance(path, size, memory)
            if path.suffix != '.zstd':
                return File(_mapped(stream), allowance)
            with tempfile.TemporaryFile() as unpacked:
                _unpack(path, stream, max(CHUNK, RATIO * size), unpacked)
                return File(_mapped(unpacked), allowance)
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error.strerror}') from None


def scan_file(path: Path, memory: int = MEMORY) -> Iterator[Record]:
    """Records of a file, see :func:`mcap_records.scan`.

    Raises:
        BagError: it cannot be read, or takes more than is allowed.
    """
    return scan(*open_file(path, memory))


def custom_data(bag: Path) -> dict[str, str]:
    """What metadata.yaml says about the experiment; empty when it is missing or broken."""
    directory = bag if bag.is_dir() else bag.parent
    try:
        with _regular(directory / 'metadata.yaml') as stream:
            text = stream.read(YAML + 1).decode()
        found = plain_data.load(text, YAML)
        facts = found['rosbag2_bagfile_information']['custom_data']
        return {key: str(value) for key, value in facts.items()} if 'config' in facts else {}
    except Exception:  # in a broken file, anything can stand anywhere
        return {}


def warning(bag: Path, damage: Iterable[Damage]) -> str:
    """One line about what is lost of a bag."""
    places = [place for place in damage if place.what != 'end']
    what = 'was not closed and ends with its last finished chunk'
    if places:
        where = f'{len(places)} places' if len(places) > 1 else 'one place'
        what = f'is damaged in {where}, {sum(place.length for place in damage)} bytes are lost'
    return f'{bag} {what}; parallel_robot recover makes a whole bag of it'


def _regular(path: Path) -> IO[bytes]:
    """Open a file, but nothing that only looks like one: a pipe would be waited for.

    Raises:
        OSError: it cannot be opened.
    """
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(errno.EINVAL, 'not a file', str(path))
    return open(number, 'rb')


def _unpack(path: Path, packed: IO[bytes], most: int, unpacked: IO[bytes]) -> None:
    """Unpack a file up to where it is broken.

    Raises:
        BagError: it is larger than `most` [bytes], or than half of what is free on the disk.
        OSError: the disk is full.
    """
    free = shutil.disk_usage(tempfile.gettempdir()).free // 2
    with contextlib.suppress(zstandard.ZstdError):  # what follows is lost
        pieces = zstandard.ZstdDecompressor().read_to_iter(packed, write_size=PIECE)
        for piece in pieces:
            unpacked.write(piece)
            if unpacked.tell() > most:
                raise BagError(f'{path} unpacks to more than {RATIO} times its size')
            if unpacked.tell() > free:
                where = tempfile.gettempdir()
                raise BagError(f'{path} unpacks to more than half of what is free in {where}')
    unpacked.flush()


def _mapped(stream: IO[bytes]) -> memoryview:
    if stream.seek(0, 2) == 0:  # nothing cannot be mapped
        return memoryview(b'')
    return memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))


def _numbers_by_value(name: str) -> list[tuple[int, str]]:
    """Key that sorts bag_10 after bag_9."""
    return [(int(part or 0), text) for text, part in re.findall(r'(\D*)(\d*)', name)]


def _joined(records: Iterable[Record]) -> Iterator[Record]:
    """Records whose small blocks are put together: numpy works on few large arrays."""
    small: list[Block] = []
    size = 0
    for record in records:
        if not isinstance(record, Block) or len(record.data) > LARGE:
            yield record
            continue
        small.append(record)
        size += len(record.data)
        if size > LARGE:
            yield _join(small)
            small, size = [], 0
    if small:
        yield _join(small)


def _join(blocks: list[Block]) -> Block:
    begins = np.cumsum([0, *(len(block.data) for block in blocks)])
    starts = [block.starts + begin for block, begin in zip(blocks, begins, strict=False)]
    return Block(memoryview(b''.join(block.data for block in blocks)), np.concatenate(starts))


def _messages(
    block: Block, channels: Mapping[int, tuple[str, Topic]], allowance: Allowance
) -> Iterator[tuple[int, Messages]]:
    """Messages of a block by channel and length."""
    heads = block.heads()
    for channel in channels:
        here = np.flatnonzero(heads['channel'] == channel)
        lengths = heads['length'][here]
        kinds = {*lengths.tolist()} - {MESSAGE_HEAD}  # what has no payload says nothing
        if len(kinds) > LENGTHS:
            raise BagError(f'{channels[channel][0]} has messages of more than {LENGTHS} lengths')
        for length in kinds:
            these = here[lengths == length]
            times = heads['log_time'][these].astype(np.int64)
            rows = block.cut(HEAD + MESSAGE_HEAD, length - MESSAGE_HEAD, these)
            if rows[0].tobytes().startswith(zstandard.FRAME_HEADER):
                yield from ((channel, messages) for messages in _plain(times, rows, allowance))
            else:
                yield channel, Messages(times, rows.view(np.uint8).reshape(len(rows), -1))


def _plain(times: np.ndarray, rows: np.ndarray, allowance: Allowance) -> Iterator[Messages]:
    """Messages that were packed one by one, those of one length together."""
    groups: dict[int, list[tuple[int, bytes]]] = {}
    size = 0
    for k, row in enumerate(rows):
        payload = plain(row.tobytes(), allowance)
        groups.setdefault(len(payload), []).append((k, payload))
        size += len(payload)
        if size > LARGE:
            yield from _together(times, groups)
            groups, size = {}, 0
    yield from _together(times, groups)


def _together(
    times: np.ndarray, groups: Mapping[int, Sequence[tuple[int, bytes]]]
) -> Iterator[Messages]:
    for length, group in groups.items():
        if length:
            raw = np.frombuffer(b''.join(payload for _, payload in group), np.uint8)
            yield Messages(times[[k for k, _ in group]], raw.reshape(-1, length))
