"""Writes rosbag2 bags: MCAP with raw CDR messages, and the metadata.yaml that stock tools want."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import yaml
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from parallel_robot_interface.errors import BagError
from parallel_robot_interface.topics import DEPTH, Topic

CHUNK_SIZE = 256 * 1024  # bytes; what a crash can cost
METADATA = 'parallel_robot'  # name of the MCAP metadata record with the experiment
MESSAGES = 'parallel_robot_messages'  # name of the record with written and lost messages by topic
FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class Offer(NamedTuple):
    """How a topic is described in a bag.

    Attributes:
        definition: Text of its type and of all types in it.
        digest: Hash of its type, RIHS01.
        profiles: Quality of service of each publisher.
    """

    definition: str
    digest: str
    profiles: tuple[dict[str, Any], ...]


class BagWriter:
    """Writes one bag, into a directory that must not exist yet.

    Attributes:
        directory: The bag.
        written: Messages written, by topic name without leading slash.
        certificate: What :meth:`close` writes of the messages, by topic name; nothing if empty.
    """

    def __init__(
        self, directory: Path, topics: Iterable[Topic], metadata: Mapping[str, str]
    ) -> None:
        """Create directory and file.

        Args:
            directory: Where the bag will be.
            topics: What will be written.
            metadata: Facts of the experiment; they go into both files.

        Raises:
            BagError: the directory exists or cannot be created.
        """
        self.directory = directory
        self.written: Counter[str] = Counter()
        self.certificate: dict[str, str] = {}
        self._metadata = dict(metadata)
        self._first: int | None = None
        self._last = 0
        self._path = create(directory) / f'{directory.name}_0.mcap'
        self._stream = self._path.open('xb')
        self._writer = Writer(self._stream, CHUNK_SIZE, CompressionType.ZSTD)
        self._writer.start('ros2', 'parallel_robot')
        self._writer.add_metadata(METADATA, self._metadata)
        self._channels: dict[str, int] = {}
        self._topics: dict[str, dict[str, Any]] = {}
        self._schemas: dict[str, int] = {}
        for topic in topics:
            self.add(topic, offer_of(topic))

    def add(self, topic: Topic, offer: Offer) -> None:
        """Add a topic that may be written from now on."""
        if topic.type not in self._schemas:
            self._schemas[topic.type] = self._writer.register_schema(
                topic.type, 'ros2msg', offer.definition.encode()
            )
        qos = list(offer.profiles)
        self._channels[topic.name] = self._writer.register_channel(
            f'/{topic.name}',
            'cdr',
            self._schemas[topic.type],
            {
                'offered_qos_profiles': yaml.safe_dump(qos, sort_keys=False),
                'topic_type_hash': offer.digest,
            },
        )
        self._topics[topic.name] = {
            'name': f'/{topic.name}',
            'type': topic.type,
            'serialization_format': 'cdr',
            'offered_qos_profiles': qos,
            'type_description_hash': offer.digest,
        }

    def write(self, topic: str, log_time: int, data: bytes) -> None:
        """Append one message; `log_time` in nanoseconds.

        Raises:
            OSError: the disk is full or gone.
        """
        self._writer.add_message(self._channels[topic], log_time, data, log_time)
        self.written[topic] += 1
        self._first = log_time if self._first is None else min(self._first, log_time)
        self._last = max(self._last, log_time)

    def close(self) -> None:
        """Complete the bag.

        Raises:
            OSError: the disk is full or gone; what is finished of the file stays.
        """
        try:
            if self.certificate:
                self._writer.add_metadata(MESSAGES, self.certificate)
            self._writer.finish()
        finally:
            self._stream.close()
        name = self._path.name
        span = {
            'duration': {'nanoseconds': self._last - (self._first or 0)},
            'starting_time': {'nanoseconds_since_epoch': self._first or 0},
            'message_count': self.written.total(),
        }
        information = {
            'version': 9,
            'storage_identifier': 'mcap',
            **span,
            'topics_with_message_count': [
                {'topic_metadata': topic, 'message_count': self.written[key]}
                for key, topic in self._topics.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [name],
            'files': [{'path': name, **span}],
            'custom_data': self._metadata,
            'ros_distro': 'jazzy',
        }
        text = yaml.dump(
            {'rosbag2_bagfile_information': information}, Dumper=_Dumper, sort_keys=False
        )
        (self.directory / 'metadata.yaml').write_text(text)

    def __enter__(self) -> BagWriter:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Complete the bag, also after an error: what is written stays readable."""
        self.close()


class _Dumper(yaml.SafeDumper):
    """YAML without anchors: rosbag2 reads them, but people do not."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def create(directory: Path) -> Path:
    """Make the directory of a new bag.

    Raises:
        BagError: it exists or cannot be created.
    """
    check(directory)
    try:
        directory.mkdir(parents=True)
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None
    return directory


def check(directory: Path) -> None:
    """Refuse a directory that exists or cannot be made, without leaving a trace.

    Raises:
        BagError: with the reason.
    """
    try:
        if directory.exists():
            raise BagError(f'{directory} exists; nothing is overwritten, choose another --out')
        parent = next(parent for parent in directory.absolute().parents if parent.exists())
        with tempfile.TemporaryDirectory(dir=parent):
            pass
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None


def offer_of(topic: Topic) -> Offer:
    """How a topic of the suite is described."""
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(topic.type, ros_version=2)
    return Offer(text, store.hash_rihs01(topic.type), (qos_profile(True, topic.latched),))


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
