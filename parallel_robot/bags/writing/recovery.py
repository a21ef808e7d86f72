"""A whole bag of what is intact in another one."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap import records as mcap

from parallel_robot.bags.files import bag_files, bag_kinds
from parallel_robot.bags.files.bag_files import MESSAGES, METADATA, ROSBAG2, File, open_file
from parallel_robot.bags.files.mcap_reader import Damage
from parallel_robot.bags.files.mcap_records import Block, unpacked_payload
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.messages.message_types import Channel
from parallel_robot.bags.output import Progress, check_directory
from parallel_robot.bags.run import recording
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_model.common.errors import BagError, RunError, WholeNeededError
from parallel_robot_model.common.options import optional_path, path
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.configuration.config import Place

# Metadata about the content of a file.
WRITTEN_ANEW = (METADATA, MESSAGES, ROSBAG2)


@dataclass(repr=False)
class Recovery(ShownResult):
    """What was kept and what was lost."""

    # messages copied, by full name of the topic
    kept: Counter[str] = field(default_factory=Counter)
    chunks: int = 0  # chunks copied
    # messages in the broken bag by its own count, by topic; empty without a count
    written: Counter[str] = field(default_factory=Counter)
    written_chunks: int = 0  # chunks in the broken bag by its own count
    # messages missing from the regular stamps, by name without leading slash
    missing: dict[str, int] = field(default_factory=dict)
    damage: list[Damage] = field(default_factory=list)  # damaged places
    bag: Path = Path()  # the new bag

    def file_lines(self) -> list[str]:
        """Where it is."""
        return [f'bag     {self.bag}']

    def parts(self) -> list[Part]:
        """What was kept and lost, and messages lost by topic."""
        kinds = self._kinds
        lines = [
            f'kept    {self.kept.total()} messages in {self.chunks} chunks',
            f'lost    {self._lost} bytes, {self._lost_chunks} chunks',
        ]
        if kinds:
            lines[-1] += f'; damaged: {", ".join(f"{kind} ({n})" for kind, n in kinds.items())}'
        gone = self._gone
        rows = [[topic, f'{count}', 'messages'] for topic, count in sorted(gone.items())]
        rows += [
            [f'/{topic}', f'{count}', 'messages, by the rhythm of their stamps']
            for topic, count in self.missing.items()
            if count and f'/{topic}' not in gone
        ]
        table = Table(['topic', 'lost', 'what'], rows, 'lrl', bare=True)
        return [*lines, *([table] if rows else [])]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            'kept': dict(self.kept),
            'kept_chunks': self.chunks,
            'lost_bytes': self._lost,
            'lost_chunks': self._lost_chunks,
            'damaged': dict(self._kinds),
            'lost': dict(sorted(self._gone.items())),
            'missing': {f'/{topic}': count for topic, count in self.missing.items() if count},
        }

    @property
    def _lost(self) -> int:
        return sum(place.length for place in self.damage)

    @property
    def _kinds(self) -> Counter[str]:
        return Counter(place.what for place in self.damage)

    @property
    def _lost_chunks(self) -> int:
        return max(self.written_chunks - self.chunks, self._kinds['chunk'])

    @property
    def _gone(self) -> Counter[str]:
        return self.written - self.kept


def recover(bag: Place, out: Place | None = None, *, memory: int = MEMORY) -> Recovery:
    """Write a whole bag of what is intact in a broken one, as ``parallel_robot recover`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/broken')
    >>> pr.recover('runs/broken', 'runs/whole').kept['/joint_states']
    101

    Args:
        bag: Directory of a bag, or one file of it.
        out: Directory of the new bag, which must not exist; default: BAG_recovered.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: nothing in it is intact, or the directory exists.
        RunError: the disk is full.
    """
    broken = path('a bag', bag)
    real = Path(os.path.realpath(broken))  # in a loop of links too
    name = real.name.removesuffix('.zstd').removesuffix('.mcap')
    place = optional_path('out', out) or real.parent / f'{name}_recovered'
    recovery = copy(broken, place, memory)
    recovery.bag = place
    recovery.missing = _missing(place, memory)  # whatever it finds, the new bag stays
    return recovery


def copy(
    bag: str | Path,
    out: str | Path,
    memory: int = MEMORY,
    add: Callable[[BagWriter], None] = lambda _: None,
) -> Recovery:
    """Write all that is intact in a bag as a new bag; leave nothing when that fails.

    Args:
        bag: Directory of the bag, or one file of it.
        out: Directory of the new one; must not exist.
        memory: Memory that reading the bag may take [bytes].
        add: Called with the writer of the new one at the end, to add more to it.

    Raises:
        BagError: nothing is intact, the bag takes too much, or `out` exists or cannot be created.
        RunError: the disk is full.
    """
    bag, out = Path(bag), Path(out)
    files = bag_files.files(bag)
    check_directory(out)
    recovery = Recovery()
    numbers: dict[Channel, int] = {}
    created = False
    try:
        with BagWriter(out, (), _facts(bag, files, memory)) as writer:
            created = True
            with Progress(sum(file.stat().st_size for file in files) // 1000, 'kB') as progress:
                for file in files:
                    _copy(file, open_file(file, memory), writer, numbers, recovery, progress)
            if not recovery.kept:
                raise BagError(f'{bag} holds no message that is intact')
            add(writer)
    except BaseException as error:
        if created:  # and not by another process since the check
            shutil.rmtree(out, ignore_errors=True)
        if isinstance(error, OSError):
            raise RunError(f'cannot write {out}: {error.strerror}') from None
        raise
    return recovery


def _copy(
    path: Path,
    file: File,
    writer: BagWriter,
    numbers: dict[Channel, int],
    recovery: Recovery,
    progress: Progress,
) -> None:
    """Copy what is intact in a file; new channels are added to `numbers`."""
    schemas: dict[int, mcap.Schema] = {}
    channels: dict[int, Channel] = {}
    written: dict[int, int] = {}
    for record in bag_kinds.records(path, file):
        if isinstance(record, mcap.Schema):
            schemas[record.id] = record
        elif isinstance(record, mcap.Channel):
            channels[record.id] = _channel(record, schemas.get(record.schema_id))
        elif isinstance(record, mcap.Statistics):
            written = record.channel_message_counts
            recovery.written_chunks += record.chunk_count
        elif isinstance(record, mcap.Metadata) and record.name not in WRITTEN_ANEW:
            writer.note(record.name, record.metadata)
        elif isinstance(record, mcap.Attachment):
            writer.attach(record.name, record.data, record.media_type, record.create_time)
        elif isinstance(record, Damage):
            recovery.damage.append(record)
        elif isinstance(record, Block):
            recovery.chunks += 1
            progress.show(writer.size // 1000)
            for source, sequence, log_time, publish_time, begin, end in record.rows():
                channel = channels[source]
                if channel not in numbers:
                    numbers[channel] = writer.add(channel)
                payload = unpacked_payload(bytes(record.data[begin:end]), file.allowance)
                writer.append(numbers[channel], log_time, payload, publish_time, sequence)
                recovery.kept[channel.topic] += 1
    for source, count in written.items():
        if source in channels:
            recovery.written[channels[source].topic] += count


def _channel(channel: mcap.Channel, schema: mcap.Schema | None) -> Channel:
    schema = schema or mcap.Schema(0, b'', '', '')
    metadata = tuple(sorted(channel.metadata.items()))
    return Channel(channel.topic, schema.name, schema.encoding, schema.data, metadata)


def _facts(bag: Path, files: list[Path], memory: int) -> dict[str, str]:
    """What the suite wrote about the experiment; empty if nothing."""
    facts = bag_files.custom_data(bag)
    for file in files if not facts else ():
        for record in bag_kinds.records(file, open_file(file, memory)):
            if isinstance(record, mcap.Metadata) and record.name == METADATA:
                return record.metadata
            if isinstance(record, Block):
                break
    return facts


def _missing(out: Path, memory: int) -> dict[str, int]:
    """Messages missing from the regular stamps of each topic; empty without a run of the suite."""
    try:
        try:
            return _counted(recording.chunks(out, SECONDS, memory=memory))
        except WholeNeededError:
            return _counted(iter([recording.read(out, memory=memory)]))
    except BagError:
        return {}


def _counted(windows: Iterator[Recording]) -> dict[str, int]:
    missing: Counter[str] = Counter()
    for found in windows:
        for name, count in found.log.messages.items():
            missing[name] += count.missing
    return dict(missing)
