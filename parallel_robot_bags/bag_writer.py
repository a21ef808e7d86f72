"""Writes rosbag2 bags: MCAP with raw CDR messages, and the metadata.yaml that stock tools want."""

from __future__ import annotations

import contextlib
import functools
import signal
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, cast

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from parallel_robot_bags import plain_data
from parallel_robot_base.errors import BagError
from parallel_robot_base.topics import DEPTH, Topic

CHUNK_SIZE = 255 * 1024  # bytes, and the message that goes beyond: at most 256 KiB
METADATA = 'parallel_robot'  # name of the MCAP metadata record with the experiment
MESSAGES = 'parallel_robot_messages'  # name of the record with written and lost messages by topic
PARAMETERS = 'parallel_robot_parameters'  # of records with the parameters of nodes at the start
CHANGES = 'parallel_robot_changes'  # of records with a later change of parameters
LAWS = 'own_laws/'  # begin of the names of attachments with the source of a law of one's own
MISSING_LAWS = 'parallel_robot_missing_laws'  # of records with why a law is not attached, by file
FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class Channel(NamedTuple):
    """A topic as a bag describes it.

    Attributes:
        topic: Full name, with its leading slash.
        type: ROS type.
        encoding: Of the definition, e.g. ``ros2msg``.
        definition: The type and the types in it.
        metadata: Key and value: ``offered_qos_profiles`` (YAML), ``topic_type_hash``.
    """

    topic: str
    type: str
    encoding: str
    definition: bytes
    metadata: tuple[tuple[str, str], ...]


class BagWriter:
    """Writes one bag, into a directory that must not exist yet.

    A finished chunk is with the system at once: it survives the end of this process. When the disk
    is full, the file ends with the last whole record.

    Attributes:
        directory: The bag.
        written: Messages written, by topic name without leading slash.
        certificate: What :meth:`close` writes of the messages, by topic name; nothing if empty.
    """

    def __init__(
        self, directory: str | Path, topics: Iterable[Topic], metadata: Mapping[str, str]
    ) -> None:
        """Create directory and file.

        Args:
            directory: Where the bag will be.
            topics: What will be written.
            metadata: Facts of the experiment; they go into both files.

        Raises:
            BagError: the directory exists or cannot be created.
            OSError: the disk is full or gone.
        """
        self.directory = Path(directory)
        self.written: Counter[str] = Counter()
        self.certificate: dict[str, str] = {}
        self._metadata = dict(metadata)
        self._first: int | None = None
        self._last = 0
        self._path = create(directory) / f'{self.directory.name}_0.mcap'
        self._file = _RecordFile(self._path)
        self._writer = Writer(cast(Any, self._file), CHUNK_SIZE, enable_data_crcs=True)
        self._writer.start('ros2', 'parallel_robot')
        if metadata:
            self._writer.add_metadata(METADATA, self._metadata)
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._caught: list[int] = []  # signals
        self._handlers: dict[int, Any] = {}
        self._ids: dict[str, int] = {}  # numbers of channels by topic name
        self._packed = 0  # indices of chunks that are packed
        for topic in topics:
            self.add(channel_of(topic))

    def add(self, channel: Channel) -> int:
        """Declare a channel; returns its number."""
        key = channel.type, channel.definition
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                channel.type, channel.encoding, channel.definition
            )
        number = self._writer.register_channel(
            channel.topic, 'cdr', self._schemas[key], dict(channel.metadata)
        )
        self._channels[number] = channel
        self._ids[channel.topic.lstrip('/')] = number
        return number

    def write(self, topic: str, log_time: int, data: bytes) -> None:
        """Append one message; `log_time` in nanoseconds.

        Raises:
            OSError: the disk is full or gone.
        """
        self.append(self._ids[topic], log_time, data, log_time)
        self.written[topic] += 1

    def append(
        self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Append one message of a channel by its number; times in nanoseconds.

        Raises:
            OSError: the disk is full or gone.
        """
        if self._caught:
            self._heed_signals()
        self._writer.add_message(channel, log_time, data, publish_time, sequence)
        self._counts[channel] += 1
        self._first = log_time if self._first is None else min(self._first, log_time)
        self._last = max(self._last, log_time)

    @property
    def size(self) -> int:
        """Length of the file [bytes]."""
        return self._file.tell()

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Write a metadata record; unlike messages, it is with the system at once.

        Raises:
            OSError: the disk is full or gone.
        """
        self._writer.add_metadata(name, dict(facts))

    def attach(self, name: str, data: bytes, kind: str = 'text/plain', at: int = 0) -> None:
        """Write an attachment of a media type, made at a time [ns]; 0: now.

        Raises:
            OSError: the disk is full or gone.
        """
        now = time.time_ns()
        self._writer.add_attachment(at or now, now, name, kind, data)

    def flush(self, age: float = 0.0) -> None:
        """Finish the open chunk if the one before was finished `age` seconds ago, or longer.

        Raises:
            OSError: the disk is full or gone.
        """
        if time.monotonic() - self._file.written_at >= age:
            self._writer.flush()
        indices = vars(self._writer).get('_Writer__chunk_indices', [])  # kept until the end
        for k in range(self._packed, len(indices)):
            indices[k] = _PackedIndex(indices[k])
        self._packed = len(indices)

    def close(self) -> None:
        """Complete the bag, or leave it as it was when the disk became full.

        Raises:
            OSError: the disk is full or gone; what is finished of the file stays.
        """
        if self._file.closed:
            return
        try:
            if self.certificate:
                self._writer.add_metadata(MESSAGES, self.certificate)
            self._writer.finish()
        finally:
            self._file.close()
        text = yaml.dump(
            {'rosbag2_bagfile_information': self._information()}, Dumper=_Dumper, sort_keys=False
        )
        draft = self.directory / 'metadata.yaml.part'
        try:
            draft.write_text(text)
            draft.rename(self.directory / 'metadata.yaml')
        except OSError:
            draft.unlink(missing_ok=True)
            raise

    def _information(self) -> dict[str, Any]:
        """What metadata.yaml says."""
        name = self._path.name
        span = {
            'duration': {'nanoseconds': self._last - (self._first or 0)},
            'starting_time': {'nanoseconds_since_epoch': self._first or 0},
            'message_count': self._counts.total(),
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **span,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': channel.topic,
                        'type': channel.type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': _profiles(channel),
                        'type_description_hash': dict(channel.metadata).get('topic_type_hash', ''),
                    },
                    'message_count': self._counts[number],
                }
                for number, channel in self._channels.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [name],
            'files': [{'path': name, **span}],
            'custom_data': self._metadata,
            'ros_distro': 'jazzy',
        }

    def __enter__(self) -> BagWriter:
        """Return the writer; in the block, signals take effect between two messages."""
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                handler = signal.signal(number, lambda number, _: self._caught.append(number))
                self._handlers[number] = handler or signal.SIG_DFL
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Complete the bag, also after an error: what is written stays readable."""
        try:
            self.close()
        finally:
            for number, handler in self._handlers.items():
                signal.signal(number, handler)
        if kind is None:
            self._heed_signals()

    def _heed_signals(self) -> None:
        for number in self._caught:
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)


class _PackedIndex:
    """Index of a chunk as it will be written: a fourth of the memory, and all of them are kept."""

    __slots__ = ('_data',)

    def __init__(self, index: ChunkIndex) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._data = builder.end()

    def write(self, builder: RecordBuilder) -> None:
        """Append it to the end of a bag."""
        builder.write(self._data)


class _RecordFile:
    """A file as mcap's writer wants it, whose every write is with the system, whole or not at all.

    Attributes:
        written_at: When it was last written [s], of the monotonic clock.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('xb', buffering=0)
        self._end = 0
        self.written_at = time.monotonic()

    @property
    def closed(self) -> bool:
        """Whether nothing can be written any more."""
        return self._file.closed

    def write(self, data: bytes) -> int:
        """Append; at an error, take back what was written of `data` and close.

        Raises:
            OSError: the disk is full or gone.
        """
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            with self._file, contextlib.suppress(OSError):
                self._file.truncate(self._end)
            raise
        self._end += len(data)
        self.written_at = time.monotonic()
        return len(data)

    def tell(self) -> int:
        """Length of the file [bytes]."""
        return self._end

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


# Written in C where that is installed: ten times faster.
class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """YAML without anchors: rosbag2 reads them, but people do not."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def create(directory: str | Path) -> Path:
    """Make the directory of a new bag.

    Raises:
        BagError: it exists or cannot be created.
    """
    directory = Path(directory)
    check(directory)
    try:
        directory.mkdir(parents=True)
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None
    return directory


def check(directory: str | Path) -> None:
    """Refuse a directory that exists or cannot be made, without leaving a trace.

    Raises:
        BagError: with the reason.
    """
    directory = Path(directory)
    try:
        if directory.exists():
            raise BagError(f'{directory} exists; nothing is overwritten, choose another --out')
        parent = next(parent for parent in directory.absolute().parents if parent.exists())
        with tempfile.TemporaryDirectory(dir=parent):
            pass
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None


def channel(
    name: str, kind: str, definition: str, digest: str, profiles: Iterable[Mapping[str, Any]]
) -> Channel:
    """A topic as a bag describes it.

    Args:
        name: Without leading slash.
        kind: ROS type.
        definition: Text of the type and of all types in it.
        digest: Hash of the type, RIHS01.
        profiles: Quality of service of each publisher.
    """
    metadata = (
        ('offered_qos_profiles', yaml.safe_dump(list(profiles), sort_keys=False)),
        ('topic_type_hash', digest),
    )
    return Channel(f'/{name}', kind, 'ros2msg', definition.encode(), metadata)


@functools.cache
def channel_of(topic: Topic) -> Channel:
    """A topic of the suite as a bag describes it."""
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(topic.type, ros_version=2)
    profiles = [qos_profile(True, topic.latched)]
    return channel(topic.name, topic.type, text, store.hash_rihs01(topic.type), profiles)


def _profiles(channel: Channel) -> list[Any]:
    """Quality of service for metadata.yaml, where it is in the form of its version."""
    try:
        profiles = plain_data.load(dict(channel.metadata).get('offered_qos_profiles', ''))
    except ValueError:
        return []
    if isinstance(profiles, list) and all(_has_words(profile) for profile in profiles):
        return profiles
    return []


def _has_words(profile: Any) -> bool:
    return isinstance(profile, dict) and isinstance(profile.get('reliability'), str)


def certify(written: int, lost: int | str) -> str:
    """What the certificate says of one topic."""
    return f'written {written}, lost {lost}'


def qos_profile(reliable: bool, latched: bool) -> dict[str, Any]:
    """Quality of service as rosbag2 writes it."""
    return {
        'history': 'keep_last',
        'depth': 1 if latched else DEPTH,
        'reliability': 'reliable' if reliable else 'best_effort',
        'durability': 'transient_local' if latched else 'volatile',
        'deadline': FOREVER,
        'lifespan': FOREVER,
        'liveliness': 'automatic',
        'liveliness_lease_duration': FOREVER,
        'avoid_ros_namespace_conventions': False,
    }
