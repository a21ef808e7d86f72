"""What a bag holds, read at one go or in windows: its run, what happened beside it, telemetry."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags import bag_reader, experiment, history
from parallel_robot.bags.bag_reader import AS_RECORDED, BagView, Messages
from parallel_robot.bags.history import ControllerStatus, History, status_decoder
from parallel_robot.bags.indexed_reader import SLACK, BagReader, Window, windows
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.messages import message_arrays, planned_motion
from parallel_robot.bags.messages.message_arrays import (
    FIRST,
    LAST,
    LOG,
    WHOLE,
    Broken,
    Samples,
    Span,
    whole,
)
from parallel_robot.bags.run import joint_table, run_log, run_messages
from parallel_robot.bags.run.aligned_run import aligned
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.errors import BagError, WholeNeededError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import (
    COMMANDS,
    JOINT_STATES,
    RECORDED,
    REFERENCE,
    STATUS,
    Topic,
)

# Bags in which joints alone were recorded, without references or commands.
#
# Who looks at the motion alone needs neither. Samples that stand in for what is not there let the
# bag be read as every other, and are taken out again.


def _with_absent_topics(
    streams: Mapping[Topic, list[Samples]], joints: Callable[[], tuple[str, ...]]
) -> tuple[dict[Topic, list[Samples]], tuple[Topic, ...]]:
    """Streams of a bag with samples in place of references and commands that are not there."""
    absent = tuple(topic for topic in (REFERENCE, COMMANDS) if topic not in streams)
    found, states = dict(streams), streams.get(JOINT_STATES, [])
    if absent and states:
        size = len(joints())
        found |= {topic: [_instead(topic, part, size) for part in states] for topic in absent}
    return found, absent


def without_absent_topics(log: RunLog, absent: Collection[Topic]) -> RunLog:
    """A run without what stood in for topics that are not there."""
    messages = dict(log.messages)
    for topic in absent:
        messages.pop(topic.name, None)
    log = log._replace(messages=messages)
    if REFERENCE in absent:
        none = np.full_like(log.position, np.nan)
        log = log._replace(
            reference_position=none,
            reference_velocity=none,
            reference_acceleration=none,
            referenced=np.zeros(len(log.stamps), bool),
        )
    return log._replace(command=log.command[:0]) if COMMANDS in absent else log


def _instead(topic: Topic, states: Samples, size: int) -> Samples:
    """Samples as if each state had one of a topic, for so many joints."""
    none = np.zeros((len(states.stamps), len(states.joints)))
    position = states.numbers.get('position', none)  # states without one are told of later
    if topic == REFERENCE:
        zero = np.zeros_like(position)
        numbers = {'position': position, 'velocity': zero, 'acceleration': zero}
        return Samples(states.joints, states.log_times, states.stamps, numbers)
    data = {'data': np.full((len(position), size), np.nan)}
    return Samples((), states.log_times, np.zeros_like(states.stamps), data)


AROUND = 0.2  # s of messages before and after a window that are read with it
TRIES = 1, 30, None  # margins before a window [SLACK] from where on it is looked for


class Recording(NamedTuple):
    """What a bag holds."""

    log: RunLog  # the run, or a window of it
    history: History  # what happened beside the motion, in the whole bag
    # messages of the other topics that were asked for; without those that the bag does not
    # have for these joints
    extra: dict[Topic, Samples]


def read(
    bag: str | Path,
    topics: Collection[Topic] = (),
    memory: int = MEMORY,
    motion_only: bool = False,
    view: BagView = AS_RECORDED,
    window: tuple[float, float] | None = None,
) -> Recording:
    """Read a bag of the nodes, of a simulation, or of any recorder that heard the suite's topics.

    Damaged parts are left out; the warnings of the log say so.

    Args:
        bag: Directory of the bag, or its MCAP file.
        topics: What else is wanted, of TELEMETRY: topics with a position for each joint.
        memory: What may be held of it [bytes].
        motion_only: Whether references and commands may be missing: NaN, and none.
        view: What it does not say itself, and which part is wanted.
        window: Which states: the time of the first one and an end, which is not in it, since
            t = 0 [s]; by its index, little more is read of the bag. None: all of them.

    Raises:
        BagError: not a bag, or one that is not of a run or takes too much; or a topic that the
            log needs, or a state in the window, is not in it.
    """
    if window is None:
        source = _Source(Path(bag), topics, memory, motion_only, view, indexed=False)
        found = source.recording(source.found.streams, WHOLE)
        if view.whole:
            return found
        return found._replace(log=run_log.between(Path(bag), found.log, view.start, view.stop))
    return Seekable(bag, topics, memory, motion_only, view).between(*window)


class Seekable:
    """A bag of which parts are read at any times; arguments as of :func:`read`."""

    def __init__(
        self,
        bag: str | Path,
        topics: Collection[Topic] = (),
        memory: int = MEMORY,
        motion_only: bool = False,
        view: BagView = AS_RECORDED,
    ) -> None:
        """Open a bag.

        Raises:
            BagError: it is none, or not one of a run.
        """
        self._source = _Source(Path(bag), topics, memory, motion_only, view)

    def between(self, begin: float, end: float) -> Recording:
        """The states from one time up to another one [s].

        Raises:
            BagError: there is none.
        """
        return self._source.window((begin, end))


def chunks(
    bag: str | Path,
    seconds: float,
    topics: Collection[Topic] = (),
    memory: int = MEMORY,
    motion_only: bool = False,
    view: BagView = AS_RECORDED,
) -> Iterator[Recording]:
    """Read a bag of any length in windows, one after the other, each message in one of them.

    All of them together have the states, answers and counts of :func:`read`; only what a broken
    file lacks may be counted otherwise. A bag that is damaged elsewhere than at its end is read
    at once.

    Args:
        bag: Directory of the bag, or its MCAP file.
        seconds: Length of the windows [s]; one without states is one with the next.
        topics: What else is wanted, see :func:`read`.
        memory: What may be held of it at once [bytes].
        motion_only: Whether references and commands may be missing, see :func:`read`.
        view: What it does not say itself, and which part is wanted.

    Raises:
        BagError: it is not a bag, or a window takes too much.
        WholeNeededError: a window is not one of a run; or the stamps of the states go far back,
            as in a second run.
    """
    source = _Source(Path(bag), topics, memory, motion_only, view)
    yield from source.chunks(round(seconds * NANOSECONDS))


def size(bag: str | Path, view: BagView = AS_RECORDED) -> tuple[float, int]:
    """Duration of a bag [s] and about how many states it has; zero where that is not known.

    Args:
        bag: Directory of the bag, or its MCAP file.
        view: What it does not say itself.
    """
    try:
        reader = BagReader(bag, make_index=True)
    except BagError:
        return 0.0, 0
    kinds = {name: topic.type for name, topic in reader.topics.items()}
    states = [
        reader.counts[name]
        for name, kind in kinds.items()
        if view.topic_of(name, kind, (JOINT_STATES,))
    ]
    return (reader.end - reader.start) / NANOSECONDS, max(states, default=0)


class _Source:
    """A bag with all that is known of it without its motion; with it, where it has no index."""

    def __init__(
        self,
        bag: Path,
        topics: Collection[Topic],
        memory: int,
        motion_only: bool,
        view: BagView,
        indexed: bool = True,
    ) -> None:
        self._bag, self._topics, self._memory = bag, topics, memory
        self._motion_only, self._view = motion_only, view
        self._broken: dict[Topic, Broken] = {}
        self._decode = message_arrays.decoder(bag, {*LOG, *topics}, self._broken)
        self._others = message_arrays.decoder(bag, ())
        self._status = status_decoder(bag)
        self._told: list[tuple[int, ControllerStatus]] = []
        self._names: dict[str, Topic] = {}  # of the index; in a broken bag, data may differ
        self._table = joint_table.is_table(bag)
        self._reader = self._indexed() if indexed and not self._table else None
        if self._table:
            self.found = joint_table.read(bag, view)
            self._names = self._meant(self.found.channels)
        elif self._reader is None:
            self.found = bag_reader.read(bag, RECORDED, self._condense, memory, view)
            self._names = self._meant(self.found.channels)
        else:
            told = [name for name, topic in self._names.items() if topic == STATUS]
            skipped = self._reader.without(told)
            self.found = bag_reader.read(bag, (STATUS,), self._condense, memory, view, skipped)
        self._past = history.of(self.found, self._told)
        self._settings = experiment.configuration(
            bag, self.found.metadata, self._past.parameters, view
        )

    def recording(
        self, streams: Mapping[str, Sequence[Sequence[Samples]]], span: Span, last: bool = True
    ) -> Recording:
        """The recording of some messages; the last one tells the damage of the bag."""
        known, absent = self._known(streams)
        log = aligned(self._bag, self.found, known, self._settings, self._view, span)
        log = without_absent_topics(log, absent)
        there = {topic: parts for topic, parts in known.items() if topic not in absent}
        missing = () if self._table else absent  # of a table, nobody wants them
        lacking = [run_messages.wanted(self._bag, topic, there, self.found) for topic in missing]
        left = [
            f'{self._bag}: {each.number} messages on {topic.name} are not understood: '
            f'{each.reason}; they are left out'
            for topic, each in self._broken.items()
        ]
        self._broken.clear()
        log = log._replace(warnings=(*log.warnings, *left, *lacking))
        if last and self._reader and self._reader.damage:
            damage = bag_reader.warning(self._bag, self._reader.damage)
            log = log._replace(warnings=(damage, *log.warnings))
        extra = {}
        for topic in {*self._topics} & known.keys():
            try:
                samples = whole(self._bag, topic, known[topic], log.joints)
            except BagError:  # of other joints, or not the suite's
                continue
            extra[topic] = samples.rows(span.holds(topic, samples))
        return Recording(log, self._past, extra)

    def chunks(self, width: int) -> Iterator[Recording]:
        """Windows of a width [ns]."""
        start, _ = self._begin()
        first, last = (None, None) if self._view.whole else (self._view.start, self._view.stop)
        begin = FIRST if first is None else start + round(first * NANOSECONDS)
        stop = LAST if last is None else start + round(last * NANOSECONDS) + 1

        def end_of(stamp: int) -> int:
            end = start + width * ((stamp - start) // width + 1)
            return min(end, stop) if stamp < stop else end

        for window in self._windows(FIRST, begin, end_of):
            if window.span.begin >= stop:
                break
            try:
                found = self.recording(window.streams, window.span, window.span.end >= stop)
            except BagError as error:  # perhaps of the window alone
                raise WholeNeededError(str(error)) from None
            yield found

    def window(self, times: tuple[float, float]) -> Recording:
        """The window between two times [s]."""
        start, offset = self._begin()
        begin, end = (start + round(time * NANOSECONDS) for time in times)
        for margin in TRIES:
            since = FIRST if margin is None else begin + offset - margin * SLACK
            window = next(self._windows(since, begin, lambda _: end), None)
            if window and (window.preceded or margin is None):
                return self.recording(window.streams, window.span)
        raise BagError(f'{self._bag} has no states from t = {times[0]:g} s to {times[1]:g} s')

    def _windows(self, since: int, begin: int, end_of: Callable[[int], int]) -> Iterator[Window]:
        """Windows of what was logged since a time."""
        around = max(AROUND, self._settings[0]['safety.reference_timeout'])
        return windows(
            self._bag,
            self._arrays(since),
            self._names,
            begin,
            end_of,
            round(around * NANOSECONDS),
            self._memory,
        )

    def _arrays(
        self, since: int = FIRST
    ) -> Iterator[tuple[list[tuple[str, list[Samples]]], int | None]]:
        """Decoded messages from a log time on [ns], and up to when they are all there."""
        if self._reader is None:
            streams = self.found.streams.items()
            named = [(name, parts) for name, parts in streams if name in self._names]
            yield [(name, part) for name, parts in named for part in parts], None
            return
        for parts, known in self._reader.arrays(self._names, since):
            yield (
                [(name, self._decoded(self._names[name], messages)) for name, messages in parts],
                known,
            )

    def _begin(self) -> tuple[int, int]:
        """Stamp of t = 0, and log time less stamp of the first states [ns]."""
        streams: dict[str, list[list[Samples]]] = {}
        needed = self._needed(self._names.values())
        for parts, _ in self._arrays():
            for name, samples in parts:
                streams.setdefault(name, []).append(samples)
            if needed <= {self._names[name] for name in streams} and self._meet(streams):
                break
        known, _ = self._known(streams)
        log = aligned(self._bag, self.found, known, self._settings, self._view)
        self._settings = (*self._settings[:2], log.start_stamp)
        if self._reader:
            self._broken.clear()  # they come again
        return log.start_stamp, int((log.heard - log.stamps).min())

    def _meet(self, streams: dict[str, list[list[Samples]]]) -> bool:
        """Whether a state has come that is not older than all references."""
        states, references = (
            [
                part.stamps
                for name, parts in streams.items()
                if self._names[name] == topic
                for part in itertools.chain(*parts)
            ]
            for topic in (JOINT_STATES, REFERENCE)
        )
        return not references or max(map(np.max, states)) >= min(map(np.min, references))

    def _known(
        self, streams: Mapping[str, Sequence[Sequence[Samples]]]
    ) -> tuple[dict[Topic, list[Samples]], tuple[Topic, ...]]:
        """Messages by topic, and the topics of which there are none."""
        known = run_messages.streams_of(self._bag, streams, self._view)
        if not self._motion_only:
            return known, ()
        return _with_absent_topics(known, lambda: self._settings[1].joints)

    def _meant(self, kinds: Mapping[str, str]) -> dict[str, Topic]:
        """Topics of the suite by their names in the bag, of types by name."""
        found = {name: self._view.topic_of(name, kind, RECORDED) for name, kind in kinds.items()}
        return {name: topic for name, topic in found.items() if topic is not None}

    def _needed(self, there: Collection[Topic]) -> set[Topic]:
        """What must be there, of topics that are there."""
        return {
            topic
            for topic in run_messages.NEEDED
            if topic == JOINT_STATES or topic in there or not self._motion_only
        }

    def _indexed(self) -> BagReader | None:
        """The bag by its index; None where that does not lead to all of a run."""
        try:
            reader = BagReader(self._bag, self._memory, make_index=True)
        except BagError:
            return None
        kinds = {name: topic.type for name, topic in reader.topics.items()}
        meant = self._names = self._meant(kinds)
        planned = any(kinds[name] == planned_motion.STATE for name in meant)
        whole = self._needed(meant.values()) <= {*meant.values()}
        return reader if whole and not planned else None

    def _condense(self, topic: Topic, messages: Messages) -> list[Samples]:
        if topic == STATUS:
            self._told.extend(self._status(topic, messages))
        return self._decoded(topic, messages)

    def _decoded(self, topic: Topic, messages: Messages) -> list[Samples]:
        try:
            return self._decode(topic, messages)
        except BagError:
            if topic not in self._topics:
                raise
            return self._others(topic, messages)  # of that name, but not the suite's
