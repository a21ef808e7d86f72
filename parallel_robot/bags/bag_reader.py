"""Messages of a bag as arrays of bytes: from any recorder, whole or damaged."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import zstandard
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from parallel_robot.bags import trust
from parallel_robot.bags.files import bag_kinds
from parallel_robot.bags.files.bag_files import METADATA, custom_data, files, open_file
from parallel_robot.bags.files.mcap_reader import UNPACKED_BY, Damage, Record
from parallel_robot.bags.files.mcap_records import (
    HEAD,
    MESSAGE_HEAD,
    Block,
    unpacked_payload,
)
from parallel_robot.bags.limits import (
    CHANNELS,
    LENGTHS,
    MEMORY,
    SOURCE,
    SOURCES,
    Allowance,
    gigabytes,
)
from parallel_robot.bags.messages import planned_motion
from parallel_robot.bags.messages.message_types import Messages as Messages
from parallel_robot_control.configuration import load, resolve
from parallel_robot_model.common.errors import BagError, InputError, UnknownNameError
from parallel_robot_model.common.options import named
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.config import Changes, changes
from parallel_robot_model.messages.topics import RECORDED, REFERENCE, Topic, full
from parallel_robot_model.robots.registry import robot_of

# How a bag is read that does not say all itself: its topics, its robot, a part of its run.

BASE = 'paper_circle'  # what a bag without a configuration is taken to be of
NAMES = {topic.name.rpartition('/')[2]: topic for topic in RECORDED} | {
    topic.name: topic for topic in RECORDED
}

INSTEAD = {REFERENCE: (planned_motion.STATE,)}  # types that are taken where they are chosen


class BagView(NamedTuple):
    """How a bag is to be read."""

    # name of a topic of the suite to that which takes its place in the bag
    topics: Mapping[str, str] = MappingProxyType({})
    # of the robot, with its leading slash; None: the only one, or none
    namespace: str | None = None
    scenario: str | None = None  # what a bag without a configuration is of; None: BASE
    # keys of the configuration and their values, over those of the scenario
    values: Mapping[str, Any] = MappingProxyType({})
    # the same for a bag without a configuration alone; with one, they are not used here
    spare: Mapping[str, Any] = MappingProxyType({})
    override: bool = False  # whether they take the place of what a bag says itself
    # time from which on states are looked at [s]; None: from the first one
    start: float | None = None
    stop: float | None = None  # time up to which they are looked at [s]; None: to the last one
    whole: bool = False  # whether the others are read, too
    # of the motors of a table of currents, the gear ratio in it [N m/A]; None: to be found
    torque_constant: tuple[float | None, ...] = ()

    def of(self, configured: bool) -> BagView:
        """How a bag with a configuration, or without one, is read."""
        given = self.values if configured else {**self.spare, **self.values}
        return self._replace(values=given, spare={})

    @property
    def assumes(self) -> bool:
        """Whether it says what the bag is of."""
        return self.scenario is not None or any(key not in config.CUSTOM for key in self.values)

    def topic_of(self, name: str, kind: str, topics: Iterable[Topic]) -> Topic | None:
        """Which of some topics a channel may be.

        Args:
            name: Full name of the channel.
            kind: Its type; empty where it is not known.
            topics: The topics.
        """
        for topic in topics:
            chosen = self.topics.get(topic.name)
            meant = name.endswith(f'/{topic.name}') if chosen is None else name == chosen
            kinds = (topic.type, '', *(INSTEAD.get(topic, ()) if chosen is not None else ()))
            if meant and kind in kinds:
                return topic
        return None

    def assumed(self) -> dict[str, Any]:
        """The configuration of a bag that has none.

        Raises:
            UnknownNameError: no such scenario or key.
            InputError: a value or a file is wrong.
        """
        values = resolve(self.scenario or BASE, self.values)
        try:
            robot_of(values)  # its joints are as many as are named
        except InputError as error:
            if self.scenario is None and 'robot_model' not in self.values:
                raise InputError(f'{error}; --scenario chooses another robot') from None
            raise
        return values

    def changed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The configuration of a bag with what takes its place.

        Raises:
            UnknownNameError: no such scenario or key.
            InputError: a value or a file is wrong.
        """
        if self.scenario is not None:
            return self.assumed()
        asked = {**values, **self.values}
        # A key of the true robot that equals that of the robot follows it.
        followers = {
            f'true_{key}': value
            for key, value in self.values.items()
            if key.startswith('robot.') and values.get(f'true_{key}') == values.get(key)
        }
        return config.changed(values, followers | dict(self.values), load(asked))

    def told(self) -> str:
        """What it says of a bag, for people; empty where it says nothing."""
        parts = [f'scenario {self.scenario}'] if self.scenario is not None else []
        keys = {key: value for key, value in self.values.items() if key not in config.CUSTOM}
        return ', '.join([*parts, *(f'{key}={_as_text(value)}' for key, value in keys.items())])


AS_RECORDED = BagView()


OF_BAG = ('topic', 'namespace', 'joints', 'scenario', 'override', 'start', 'stop')


def view(
    *,
    topic: Mapping[str, str] | None = None,
    namespace: str | None = None,
    joints: Iterable[str] = (),
    scenario: str | Path | None = None,
    override: bool = False,
    start: float | None = None,
    stop: float | None = None,
    param_file: Changes = None,
    **values: Any,
) -> BagView:
    """How a bag is to be read, by what it does not say itself.

    Args:
        topic: Topic of the bag in place of one of the suite, by the name of this or its last word,
            e.g. joint_states=/robot1/joint_states, reference, commands; may be repeated.
        namespace: Of the robot, in a bag of several.
        joints: Names of the joints in the bag, in the order of those of the robot.
        scenario: What a bag without a configuration is of; default: paper_circle.
        override: Whether `scenario`, `joints`, `param_file` and keys of the configuration take the
            place of what a bag says.
        start: First time of the part that is read [s]; default: all.
        stop: Last time of the part that is read [s]; default: all.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values.

    Raises:
        InputError: one of them is wrong.
    """
    given = changes(param_file, values)
    topics, names = topic or {}, list(_listed('joints', joints))
    if not (isinstance(topics, Mapping) and {*map(type, topics.values())} <= {str}):
        raise InputError(f'topic must be names with topics of the bag, not {topics!r}')
    if not isinstance(namespace, str | None):
        raise InputError(f'namespace must be text, not {namespace!r}')
    found = {}
    for name, place in topics.items():
        if name.strip('/') not in NAMES:
            raise UnknownNameError('topic', name, NAMES)
        if not place.strip('/'):
            raise InputError(f'--topic {name}= needs the name of a topic')
        found[NAMES[name.strip('/')].name] = f'/{place.strip("/")}'
    if names:
        if 'joints' in given and list(given['joints']) != names:
            raise InputError(f'--joints {",".join(names)} and joints={given["joints"]} differ')
        given = given | {'joints': names}
    begin, end = _time('start', start), _time('stop', stop)
    if begin is not None and end is not None and not begin < end:
        raise InputError(f'--from {begin:g} must be before --to {end:g}')
    return BagView(
        found,
        None if namespace is None else full(namespace),
        None if scenario is None else named('scenario', scenario),
        given,
        override=bool(override),
        start=begin,
        stop=end,
    )


def _listed(name: str, given: Any) -> Iterable[Any]:
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InputError(f'{name} must be a list of names, not {given!r}')
    return given


def _time(name: str, given: Any) -> float | None:
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, Real) or not math.isfinite(given):
        raise InputError(f'{name} must be a time in s, not {given!r}')
    return float(given)


def _as_text(value: Any) -> str:
    return ','.join(map(str, value)) if isinstance(value, list | tuple) else str(value)


Part = TypeVar('Part')

HELP = (
    'parallel_robot recover mends one that is damaged; '
    'export, identify and replay take --to before stamps that go back'
)
LARGE = 1 << 21  # bytes of messages that are sorted at once


@dataclass(frozen=True)
class Bag(Generic[Part]):
    """What was read of a bag."""

    streams: dict[str, list[Part]]  # what `condense` returned, by full name of the topic
    # what the suite wrote about the experiment; empty when another recorded it
    metadata: dict[str, str]
    warnings: tuple[str, ...]  # what is wrong with the bag, one line each
    notes: dict[str, list[dict[str, str]]]  # other metadata records, by their name
    # source of each custom law and robot by key, as ``custom_laws``, and by name; bad names
    # and long sources are left out
    sources: dict[str, dict[str, bytes]]
    channels: dict[str, str]  # type of each topic of the bag, by its full name
    encodings: dict[str, str]  # encoding of those that are not CDR, which are not read


def read(
    bag: str | Path,
    topics: Collection[Topic],
    condense: Callable[[Topic, Messages], Part],
    memory: int = MEMORY,
    view: BagView = AS_RECORDED,
    skipped: Mapping[Path, Collection[int]] = MappingProxyType({}),
    held: bool = True,
) -> Bag[Part]:
    """Read some topics of a bag, a few megabytes at a time.

    Args:
        bag: Directory of the bag, or one file of it.
        topics: What to read, in any namespace, if the type is the same or unknown.
        condense: Turns messages into what is kept of them, which takes no more memory.
        memory: What may be held of the bag [bytes].
        view: Which topics take the place of others.
        skipped: Where chunks begin that are not wanted, by file.
        held: Whether what `condense` returns is held; else the streams are empty.

    Raises:
        BagError: nothing there is an MCAP file, or it takes more than is allowed.
    """
    bag = Path(bag)
    streams: dict[str, list[Part]] = {}
    facts: dict[str, str] = {}
    notes: dict[str, list[dict[str, str]]] = {}
    channels: dict[str, str] = {}
    encodings: dict[str, str] = {}
    sources: dict[str, dict[str, bytes]] = {key: {} for key in trust.KINDS}
    doubled: set[tuple[str, str]] = set()
    damage: list[Damage] = []
    understood = False
    there = files(bag)
    size = sum(file.stat().st_size for file in there if file.is_file())
    budget = Allowance(f'{bag}, {gigabytes(size)} read at once ({HELP}),', 0, memory)
    for file in there:
        schemas: dict[int, str] = {}
        definitions: dict[int, bytes] = {}
        translators: dict[int, Callable[[Messages], list[Messages]]] = {}
        wanted: dict[int, tuple[str, Topic]] = {}
        opened = open_file(file, memory)
        for record in _joined(bag_kinds.records(file, opened, skipped.get(file, ()))):
            understood = understood or not isinstance(record, (Damage, Header))
            if isinstance(record, Schema):
                schemas[record.id] = record.name
                if record.name == planned_motion.STATE:
                    definitions[record.id] = record.data
            elif isinstance(record, Channel):
                name = f'/{record.topic.lstrip("/")}'
                channels[name] = schemas.get(record.schema_id, '')
                if record.message_encoding not in ('cdr', ''):
                    encodings[name] = record.message_encoding
                    continue
                topic = view.topic_of(name, channels[name], topics)
                if topic is not None:
                    wanted[record.id] = name, topic
                    if channels[name] == planned_motion.STATE:
                        definition = definitions[record.schema_id].decode(errors='replace')
                        translators[record.id] = planned_motion.translator(definition)
                if len(wanted) > CHANNELS:
                    raise BagError(f'{file} has more than {CHANNELS} channels of such topics')
            elif isinstance(record, Metadata) and record.name == METADATA:
                facts = record.metadata
            elif isinstance(record, Metadata) and record.name.startswith(METADATA):
                budget.hold(sum(len(text) for pair in record.metadata.items() for text in pair))
                notes.setdefault(record.name, []).append(record.metadata)
            elif isinstance(record, Attachment) and len(record.data) <= SOURCE:
                named = trust.parse_attachment(record.name)
                if named:
                    key, name = named
                    budget.hold(len(record.data))
                    if sources[key].setdefault(name, record.data) != record.data:
                        doubled.add((key, name))
                if sum(map(len, sources.values())) > SOURCES:
                    raise BagError(f'{file} holds more than {SOURCES} custom laws and robots')
            elif isinstance(record, Damage):
                damage.append(record)
            elif isinstance(record, Block):
                for channel, messages in messages_of(record, wanted, opened.allowance):
                    budget.hold(messages.payloads.nbytes if held else 0)
                    name, of = wanted[channel]
                    stream = streams.setdefault(name, [])
                    translate = translators.get(channel)
                    for part in [messages] if translate is None else translate(messages):
                        found = condense(of, part)
                        stream.extend([found] if held else [])
    unknown = {place.what for place in damage if place.what.startswith(UNPACKED_BY)}
    if unknown and not streams:
        what = f'{bag} cannot be read: {", ".join(sorted(unknown))}'
        raise BagError(f'{what}, which is not known here; zstd, lz4 and none are')
    if not understood:
        raise BagError(f'{bag} cannot be read: nothing in it is MCAP')
    if damage or not facts:
        facts = custom_data(bag) or facts
    if plain_data.whole_number(facts.get('start_stamp', '0')) is None:
        raise BagError(f'{bag}: its start_stamp must be a whole number of nanoseconds')
    warnings = [warning(bag, damage)] if damage else []
    for key, name in sorted(doubled):
        del sources[key][name]
        warnings.append(f'{bag} holds several files {key}/{name}; none of them is used')
    return Bag(streams, facts, tuple(warnings), notes, sources, channels, encodings)


def warning(bag: Path, damage: Iterable[Damage]) -> str:
    """One line that says what is lost of a bag."""
    places = [place for place in damage if place.what != 'end']
    what = 'was not closed and ends with its last finished chunk'
    if places:
        where = f'{len(places)} places' if len(places) > 1 else 'one place'
        what = f'is damaged in {where}, {sum(place.length for place in damage)} bytes are lost'
    return f'{bag} {what}; parallel_robot recover makes a whole bag of it'


def _joined(records: Iterable[Record]) -> Iterator[Record]:
    """Records with small blocks joined, because numpy is fast on large arrays."""
    small: list[Block] = []
    size = 0
    for record in records:
        if not isinstance(record, Block) or len(record.data) > LARGE:
            yield record
            continue
        small.append(record)
        size += len(record.data)
        if size > LARGE:
            yield join(small)
            small, size = [], 0
    if small:
        yield join(small)


def join(blocks: Sequence[Block]) -> Block:
    """The messages of some blocks as one."""
    begins = np.cumsum([0, *(len(block.data) for block in blocks)])
    starts = [block.starts + begin for block, begin in zip(blocks, begins, strict=False)]
    return Block(memoryview(b''.join(block.data for block in blocks)), np.concatenate(starts))


def messages_of(
    block: Block, channels: Mapping[int, tuple[str, Topic]], allowance: Allowance
) -> Iterator[tuple[int, Messages]]:
    """Messages of a block by channel and length."""
    heads = block.heads()
    for channel in channels:
        here = np.flatnonzero(heads['channel'] == channel)
        lengths = heads['length'][here]
        kinds = {*lengths.tolist()} - {MESSAGE_HEAD}  # empty payloads are ignored
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
    """Messages that were compressed one by one, grouped by length."""
    groups: dict[int, list[tuple[int, bytes]]] = {}
    size = 0
    for k, row in enumerate(rows):
        payload = unpacked_payload(row.tobytes(), allowance)
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
