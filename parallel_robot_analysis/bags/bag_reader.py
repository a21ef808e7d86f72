"""Messages of a bag as arrays of bytes, whoever recorded it and however it ended."""

from __future__ import annotations

import contextlib
import mmap
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Generic, NamedTuple, TypeVar

import numpy as np
import yaml
import zstandard
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from parallel_robot_analysis.bags.bag_writer import METADATA
from parallel_robot_analysis.bags.mcap_records import (
    HEAD,
    MESSAGE_HEAD,
    Block,
    Damage,
    Record,
    plain,
    scan,
)
from parallel_robot_interface.config import LOADER
from parallel_robot_interface.errors import BagError
from parallel_robot_interface.topics import Topic

Part = TypeVar('Part')

LARGE = 1 << 21  # bytes of messages that are sorted at once


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
        attachments: By name.
    """

    streams: dict[str, list[Part]]
    metadata: dict[str, str]
    warnings: tuple[str, ...]
    notes: dict[str, list[dict[str, str]]]
    attachments: dict[str, bytes]


def read(
    bag: str | Path, topics: Iterable[Topic], condense: Callable[[Topic, Messages], Part]
) -> Bag[Part]:
    """Read some topics of a bag, some megabytes at a time.

    Args:
        bag: Directory of the bag, or one file of it.
        topics: What to read, in any namespace, where the type is the same or not known.
        condense: Makes of some messages what is kept of them.

    Raises:
        BagError: nothing there is an MCAP file.
    """
    bag = Path(bag)
    streams: dict[str, list[Part]] = {}
    facts: dict[str, str] = {}
    notes: dict[str, list[dict[str, str]]] = {}
    attachments: dict[str, bytes] = {}
    damage: list[Damage] = []
    understood = False
    for file in files(bag):
        schemas: dict[int, str] = {}
        wanted: dict[int, tuple[str, Topic]] = {}
        for record in _joined(scan_file(file)):
            understood = understood or not isinstance(record, (Damage, Header))
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                name = f'/{record.topic.lstrip("/")}'
                for topic in topics:
                    same = schemas.get(record.schema_id, '') in (topic.type, '')
                    if same and name.endswith(f'/{topic.name}'):
                        wanted[record.id] = name, topic
            elif isinstance(record, Metadata) and record.name == METADATA:
                facts = record.metadata
            elif isinstance(record, Metadata):
                notes.setdefault(record.name, []).append(record.metadata)
            elif isinstance(record, Attachment):
                attachments[record.name] = record.data
            elif isinstance(record, Damage):
                damage.append(record)
            elif isinstance(record, Block):
                for channel, messages in _messages(record, wanted):
                    name, topic = wanted[channel]
                    streams.setdefault(name, []).append(condense(topic, messages))
    if not understood:
        raise BagError(f'{bag} cannot be read: nothing in it is MCAP')
    if damage or not facts:
        facts = custom_data(bag) or facts
    warnings = (warning(bag, damage),) if damage else ()
    return Bag(streams, facts, warnings, notes, attachments)


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


def scan_file(path: Path) -> Iterator[Record]:
    """Records of a file, see :func:`mcap_records.scan`.

    Raises:
        BagError: it cannot be read.
    """
    return scan(_content(path))


def custom_data(bag: Path) -> dict[str, str]:
    """What metadata.yaml says about the experiment; empty when it is missing or broken."""
    directory = bag if bag.is_dir() else bag.parent
    try:
        text = (directory / 'metadata.yaml').read_text()
        facts = yaml.load(text, LOADER)['rosbag2_bagfile_information']['custom_data']
        return {str(key): str(value) for key, value in facts.items()} if 'config' in facts else {}
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


def _content(path: Path) -> memoryview:
    """Content of a file, mapped rather than loaded, unpacked if it is packed as a whole."""
    try:
        with path.open('rb') as stream:
            if path.suffix != '.zstd':
                return _mapped(stream)
            with tempfile.TemporaryFile() as unpacked:
                with contextlib.suppress(zstandard.ZstdError):  # what follows is lost
                    shutil.copyfileobj(
                        zstandard.ZstdDecompressor().stream_reader(stream), unpacked
                    )
                unpacked.flush()
                return _mapped(unpacked)
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error.strerror}') from None


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


def _messages(block: Block, channels: Iterable[int]) -> Iterator[tuple[int, Messages]]:
    """Messages of a block by channel and length."""
    heads = block.heads()
    for channel in channels:
        here = np.flatnonzero(heads['channel'] == channel)
        lengths = heads['length'][here]
        for length in {*lengths.tolist()} - {MESSAGE_HEAD}:  # what has no payload says nothing
            these = here[lengths == length]
            times = heads['log_time'][these].astype(np.int64)
            rows = block.cut(HEAD + MESSAGE_HEAD, length - MESSAGE_HEAD, these)
            if rows[0].tobytes().startswith(zstandard.FRAME_HEADER):
                for k, row in enumerate(rows):
                    payload = np.frombuffer(plain(row.tobytes()), np.uint8)
                    yield channel, Messages(times[k : k + 1], payload[np.newaxis])
            else:
                yield channel, Messages(times, rows.view(np.uint8).reshape(len(rows), -1))
