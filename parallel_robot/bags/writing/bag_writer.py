"""Writes rosbag2 bags: MCAP with raw CDR messages, and the metadata.yaml that stock tools want."""

from __future__ import annotations

import signal
import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from parallel_robot.bags import output
from parallel_robot.bags.files.bag_files import MESSAGES, METADATA, ROSBAG2, Certificate
from parallel_robot.bags.files.mcap_writer import McapWriter, Rows
from parallel_robot.bags.messages.message_types import Channel, channel_of, profiles_of
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.processes.termination_signals import termination_signals

ROS_DISTRO = 'jazzy'
CHUNK_SIZE = 255 * 1024  # bytes; the message that crosses it still goes in: up to 256 KiB


class BagWriter(McapWriter):
    """Writes one bag, into a directory that must not exist yet.

    A finished chunk is handed to the operating system at once, so it survives the end of this
    process. When the disk is full or gone, OSError: the file ends with the last whole record.
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
        self.channels: dict[str, int] = {}  # their numbers, by topic name without leading slash
        # what :meth:`close` writes of the messages, by topic name; nothing if empty
        self.certificates: dict[str, Certificate] = {}
        self._metadata = dict(metadata)
        self._path = output.create_directory(directory) / f'{self.directory.name}_0.mcap'
        super().__init__(self._path, CHUNK_SIZE)
        if metadata:
            self.note(METADATA, self._metadata)
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._described: dict[int, Channel] = {}
        self._describe()  # at both ends, as ROS's recorder: a file may lack its end
        self._caught: list[int] = []  # signals
        self._handlers: dict[int, Any] = {}
        for topic in topics:
            self.add(channel_of(topic))

    @property
    def written(self) -> Counter[str]:
        """Messages written, by topic name without leading slash."""
        counts = self.statistics().channel_message_counts
        names = {number: name for name, number in self.channels.items()}
        return Counter({names[number]: count for number, count in counts.items()})

    def add(self, channel: Channel) -> int:
        """Declare a channel; returns its number."""
        key = channel.type, channel.definition
        if key not in self._schemas:
            self._schemas[key] = self.schema(channel.type, channel.encoding, channel.definition)
        facts = dict(channel.metadata)
        number = self.channel(channel.topic, self._schemas[key], facts)
        self._described[number] = channel
        self.channels[channel.topic.lstrip('/')] = number
        return number

    def write(self, topic: str, log_time: int, data: bytes) -> None:
        """Append one message; `log_time` in nanoseconds."""
        self.append(self.channels[topic], log_time, data, log_time)

    def append(
        self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Append one message of a channel by its number; times in nanoseconds."""
        if self._caught:
            self._raise_signals()
        super().append(channel, log_time, data, publish_time, sequence)

    def extend(self, streams: Sequence[Rows]) -> None:
        """Append many messages of many topics: the same bytes as by :meth:`write`, sooner."""
        numbered = [(self.channels[rows.topic], rows) for rows in streams if len(rows.places)]
        for _ in self.append_all(numbered) if numbered else ():
            if self._caught:
                self._raise_signals()

    def flush(self, age: float = 0.0) -> None:
        """Finish the open chunk if the file was last written at least `age` seconds ago."""
        if time.monotonic() - self.written_at >= age:
            self.finish_chunk()
            self.written_at = time.monotonic()

    def close(self) -> None:
        """Complete the bag, or leave it as it was when the disk became full.

        Raises:
            OSError: the disk is full or gone; what is finished of the file stays.
        """
        if self.closed:
            return
        try:
            if self.certificates:
                certified = {name: found.dump() for name, found in self.certificates.items()}
                self.note(MESSAGES, certified)
            self._describe()
            self.finish()
        finally:
            super().close()
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
        self.note(ROSBAG2, texts)

    def _information(self) -> dict[str, Any]:
        """Content of metadata.yaml."""
        name, statistics = self._path.name, self.statistics()
        first, counts = statistics.message_start_time, statistics.channel_message_counts
        span = {
            'duration': {'nanoseconds': statistics.message_end_time - first},
            'starting_time': {'nanoseconds_since_epoch': first},
            'message_count': statistics.message_count,
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
                    'message_count': counts.get(number, 0),
                }
                for number, channel in self._described.items()
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


# Written in C where that is installed: ten times faster.
class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """YAML without anchors, which rosbag2 can read but people hardly."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(tree: dict[str, Any]) -> str:
    return yaml.dump(tree, Dumper=_Dumper, sort_keys=False)
