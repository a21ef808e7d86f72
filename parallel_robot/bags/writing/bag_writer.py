"""Writes rosbag2 bags: MCAP with raw CDR messages, and the metadata.yaml that stock tools want."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

from parallel_robot.bags import output
from parallel_robot.bags.files.bag_files import MESSAGES, METADATA, ROSBAG2, Certificate
from parallel_robot.bags.messages import message_rows
from parallel_robot.bags.messages.message_types import Channel, channel_of, profiles_of
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.processes.termination_signals import termination_signals

# A file that always ends with its last whole record, also when the disk becomes full.


class RecordFile:
    """A file for mcap's writer: each write reaches the operating system whole or not at all."""

    def __init__(self, path: Path) -> None:
        self._file = path.open('xb', buffering=0)
        self._end = 0
        self.written_at = time.monotonic()  # time of the last write on the monotonic clock [s]

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
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
        """Do nothing: writes are not buffered."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


ROS_DISTRO = 'jazzy'
CHUNK_SIZE = 255 * 1024  # bytes; the message that crosses it still goes in: up to 256 KiB


class BagWriter:
    """Writes one bag, into a directory that must not exist yet.

    A finished chunk is handed to the operating system at once, so it survives the end of this
    process. When the disk is full, the file ends with the last whole record.
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
        self.directory = Path(directory)  # the bag
        # messages written, by topic name without leading slash
        self.written: Counter[str] = Counter()
        # what :meth:`close` writes of the messages, by topic name; nothing if empty
        self.certificates: dict[str, Certificate] = {}
        self._metadata = dict(metadata)
        self._first: int | None = None
        self._last = 0
        self._path = output.create_directory(directory) / f'{self.directory.name}_0.mcap'
        self._file = RecordFile(self._path)
        self._writer = Writer(cast(Any, self._file), CHUNK_SIZE, enable_data_crcs=True)
        vars(self._writer)['_Writer__chunk_indices'] = _PackedIndices()
        self._writer.start('ros2', 'parallel_robot')
        if metadata:
            self._writer.add_metadata(METADATA, self._metadata)
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._describe()  # at both ends, as ROS's recorder: a file may lack its end
        self._caught: list[int] = []  # signals
        self._handlers: dict[int, Any] = {}
        self._ids: dict[str, int] = {}  # numbers of channels by topic name
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
            self._raise_signals()
        self._writer.add_message(channel, log_time, data, publish_time, sequence)
        self._counts[channel] += 1
        self._first = log_time if self._first is None else min(self._first, log_time)
        self._last = max(self._last, log_time)

    def extend(self, streams: Sequence[message_rows.Rows]) -> None:
        """Append many messages of many topics: the same bytes as by :meth:`write`, sooner.

        Raises:
            OSError: the disk is full or gone.
        """
        numbered = [(self._ids[rows.topic], rows) for rows in streams if len(rows.places)]
        if not numbered:
            return
        batch, names = message_rows.batch_of(numbered), {n: rows.topic for n, rows in numbered}
        for part in message_rows.write(self._writer, batch, CHUNK_SIZE):
            for number, count in Counter(batch.channels[part].tolist()).items():
                self._counts[number] += count
                self.written[names[number]] += count
            first, last = int(batch.log_times[part].min()), int(batch.log_times[part].max())
            self._first = first if self._first is None else min(self._first, first)
            self._last = max(self._last, last)
            if self._caught:
                self._raise_signals()

    @property
    def size(self) -> int:
        """Length of the file [bytes]."""
        return self._file.tell()

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Write a metadata record; unlike a message, it goes to the operating system at once.

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
        """Finish the open chunk if the file was last written at least `age` seconds ago.

        Raises:
            OSError: the disk is full or gone.
        """
        if time.monotonic() - self._file.written_at >= age:
            self._writer.flush()

    def close(self) -> None:
        """Complete the bag, or leave it as it was when the disk became full.

        Raises:
            OSError: the disk is full or gone; what is finished of the file stays.
        """
        if self._file.closed:
            return
        try:
            if self.certificates:
                certified = {name: found.dump() for name, found in self.certificates.items()}
                self._writer.add_metadata(MESSAGES, certified)
            self._describe()
            self._writer.finish()
        finally:
            self._file.close()
        text = _yaml({'rosbag2_bagfile_information': self._information()})
        draft = self.directory / 'metadata.yaml.part'
        try:
            draft.write_text(text)
            draft.rename(self.directory / 'metadata.yaml')
        except OSError:
            draft.unlink(missing_ok=True)
            raise

    def _describe(self) -> None:
        """Write what rosbag2_storage_mcap reads of a file without its metadata.yaml."""
        texts = {'serialized_metadata': _yaml(self._information()), 'ROS_DISTRO': ROS_DISTRO}
        self._writer.add_metadata(ROSBAG2, texts)

    def _information(self) -> dict[str, Any]:
        """Content of metadata.yaml."""
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
                        'offered_qos_profiles': profiles_of(channel),
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
            'ros_distro': ROS_DISTRO,
        }

    def __enter__(self) -> BagWriter:
        """Return the writer; in the block, signals take effect between two messages."""
        if threading.current_thread() is threading.main_thread():
            for number in termination_signals():
                handler = signal.signal(number, lambda number, _: self._caught.append(number))
                self._handlers[number] = handler or signal.SIG_DFL
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Complete the bag, also after an error: what is written stays readable."""
        try:
            self.close()
        finally:
            for number, handler in self._handlers.items():
                signal.signal(number, handler)
        if kind is None:
            self._raise_signals()

    def _raise_signals(self) -> None:
        for number in self._caught:
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)


class _PackedIndices:
    """Indices of all chunks, which the summary at the end repeats: their records alone."""

    def __init__(self) -> None:
        self._records = bytearray()

    def append(self, index: ChunkIndex) -> None:
        """Take the index of a chunk."""
        builder = RecordBuilder()
        index.write(builder)
        self._records += builder.end()

    def __iter__(self) -> Iterator[_PackedIndices]:
        """As mcap's writer goes through them: all at once."""
        yield self

    def write(self, builder: RecordBuilder) -> None:
        """Append the records to a record builder, and give them up."""
        builder.write(self._records)
        self._records = bytearray()


# Written in C where that is installed: ten times faster.
class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """YAML without anchors, which rosbag2 can read but people hardly."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(tree: dict[str, Any]) -> str:
    return yaml.dump(tree, Dumper=_Dumper, sort_keys=False)
