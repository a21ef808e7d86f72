"""The recorder without ROS: messages come in from any thread, one thread writes the bag."""

from __future__ import annotations

import itertools
import math
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.bags import trust
from parallel_robot.bags.experiment import describe, software
from parallel_robot.bags.files.bag_files import CHANGES, MISSING, PARAMETERS, Certificate
from parallel_robot.bags.history import decoded_status
from parallel_robot.bags.messages.message_types import Channel, channel_of
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.configuration.hazard_table import HazardTable
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.layouts import header_stamp, last_state
from parallel_robot_model.messages.topics import (
    ACTIVE_LAW,
    ANSWERED,
    COMMANDS,
    JOINT_STATES,
    POSE,
    RECORDED,
    STATUS,
    TELEMETRY,
    UNSTAMPED,
    Topic,
)
from parallel_robot_sim.imperfections import reported_age

# The messages of one recorded topic: how many came, which are missing, how they are stamped.

# stamped when the state was measured, which may be before it was sent
MEASURED = (JOINT_STATES, *TELEMETRY)


class TopicStream:
    """The messages of one topic: counted, and how their log times are found."""

    def __init__(self, topic: Topic, channel: Channel, joints: int = 0) -> None:
        """Begin without messages; `joints`: how many the robot has, for topics of the suite."""
        # topic: one of the suite's, or any other; channel: how the topic is written
        self.topic, self.channel = topic, channel
        self.of_suite = topic in RECORDED  # whether it is one of the suite's
        self.is_log, self.is_state = topic == ANSWERED, topic == JOINT_STATES
        self.is_measured = topic in MEASURED
        self.is_law, self.is_status = topic == ACTIVE_LAW, topic == STATUS
        stamped = self.of_suite and topic.type not in UNSTAMPED
        read_stamp = partial(last_state, joints=joints) if self.is_log else header_stamp
        # reads the stamp of a message [ns]; None for types without one
        self.stamp_of = read_stamp if stamped else None
        self.received = 0  # messages taken
        self._missing: int | None = None
        self._restarted = False
        self._number = 0  # of the last message; 0: none had one

    def count(self, number: int) -> None:
        """Count a message, and numbers missing since the last one; a smaller number restarts."""
        self.received += 1
        if not number:
            return
        if not self._number:
            self._missing = 0
        elif number > self._number + 1 and self._missing is not None:
            self._missing += number - self._number - 1
        self._restarted |= number < self._number
        self._number = number

    @property
    def gaps(self) -> int | None:
        """Numbers missing between those that the publisher gave its messages.

        None where they are not known, several publishers number theirs, or none is missing but
        perhaps the last ones of a publisher that was started anew.
        """
        return None if self._restarted and not self._missing else self._missing

    def several(self) -> None:
        """Note that the topic has several publishers, whose numbers cannot be told apart."""
        self._missing = None
        self._number = self._number or 1


ANSWERS = (COMMANDS, *TELEMETRY, ANSWERED)  # what the controller sends for each state
DRAIN = 0.05  # s, between two rounds of writing
FLUSH = 1.0  # s, after which a chunk is finished although it is not full
STRAGGLERS = 4.0  # s, wait for missing messages after the motion; Fast DDS repairs in 3
ANSWERS_AFTER = 1.0  # s, the same when only answers are missing: states may be skipped


class Recorder:
    """Writes what it is given, from the start stamp to the end of the motion.

    In lockstep the log time is the time of the simulation: the stamp of a message, or for types
    without one the stamp of the state that the k-th message answers; the name of a law is taken
    from the first status with it, and has its stamp. In wall time it is the time of reception.
    Topics that are not the suite's have the time of the newest message that is.
    """

    def __init__(
        self,
        directory: Path,
        loop: LoopParameters,
        values: Mapping[str, Any],
        failed: Callable[[Exception], None],
        suite: Collection[Topic] = RECORDED,
    ) -> None:
        """Prepare; the bag is created by :meth:`open`.

        Args:
            directory: Where the bag will be.
            loop: Period, duration, mode.
            values: The resolved configuration, for the bag's metadata.
            failed: Called with the error when the bag cannot be written any more.
            suite: Topics of the suite that are recorded; others by :meth:`add`.
        """
        self._directory = directory
        self._loop = loop
        self._values = values
        self._age = reported_age(values)
        self._failed = failed
        self._start = 0
        self._end: int | None = None
        self._last_state: int | None = None  # ns, its stamp, where the motion has an end
        self._over = False  # whether the last state of the motion has arrived
        self._last_heard = time.monotonic()
        self._early: list[tuple[Topic, bytes, int, int]] = []  # latched, from before the start
        self._lockstep = loop.lockstep
        self._table = HazardTable(loop, float(values.get('safety.state_age', math.inf)))
        # samples whose states are answered
        self._answered = (k for k in itertools.count() if self._table.reception(k).answered)
        self._expected: dict[Topic, int] = {}  # messages of the whole motion
        self._suite = suite
        self._streams = {
            topic: TopicStream(topic, channel_of(topic), len(loop.joints)) for topic in suite
        }
        self._sources: dict[str, bytes] = {}  # attachments, made or to be made, by name
        self._newest = 0  # ns, largest stamp of the suite
        self._law = b''  # the last name of a law, as a message
        self._told = False  # whether a status has named the law
        self._queue: queue.SimpleQueue[tuple[TopicStream, int, bytes]] = queue.SimpleQueue()
        self._notes: queue.SimpleQueue[Callable[[BagWriter], None]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._writer: BagWriter | None = None
        self._thread = threading.Thread(target=self._write, name='bag', daemon=True)
        software()  # looked up now, not at the start of the motion
        for file in trust.named_files(values):
            self._attach(*file)

    def open(self, start_stamp: int = 0) -> None:
        """Create the bag and begin; stamped messages from before `start_stamp` [ns] are left out.

        Raises:
            BagError: the directory exists or cannot be created.
            RunError: the disk is full.
        """
        self._start = start_stamp or (self._loop.step_start if self._loop.lockstep else 0)
        if self._loop.last_index is not None and start_stamp:
            self._end = start_stamp + self._loop.last_index * self._loop.period_ns
            last = self._table.last_told(self._loop.last_index)
            self._last_state = start_stamp + last * self._loop.period_ns
        metadata = describe(self._loop, self._values, start_stamp)
        try:
            self._writer = BagWriter(self._directory, self._suite, metadata)
        except OSError as error:
            raise self._broken(error) from None
        self._thread.start()
        for early in self._early:
            self.take(*early)

    def add(self, topic: Topic, channel: Channel) -> None:
        """Record a topic that is not one of the suite's; before its first message is taken."""
        self._streams[topic] = TopicStream(topic, channel)

    @property
    def received(self) -> Counter[Topic]:
        """Messages taken, by topic."""
        return Counter({topic: stream.received for topic, stream in self._streams.items()})

    @property
    def losses(self) -> int:
        """How many messages are known to be missing by the numbers that publishers gave them."""
        return sum(stream.gaps or 0 for stream in self._streams.values())

    def found(self, node: str, parameters: Mapping[str, Any]) -> list[str]:
        """Note the parameters of a node at the start.

        The code that trajectory and controller name is attached.

        Returns:
            Why custom modules cannot be attached, one line each.
        """
        self._note(PARAMETERS, {node: plain_data.dump(parameters)})
        troubles = []
        owns = node.endswith(('/trajectory', '/controller'))
        for key, path in trust.named_files(parameters) if owns else ():
            try:
                self._attach(key, path)
            except InputError as error:
                troubles.append(str(error))
                self._note(MISSING[key], {path: str(error)})
        return troubles

    def changed(self, node: str, parameters: Mapping[str, Any]) -> None:
        """Note a change of parameters of a node."""
        stamp = max(self._newest, self._start)
        facts = {'stamp': str(stamp), 'node': node, 'values': plain_data.dump(parameters)}
        self._note(CHANGES, facts)

    def _note(self, name: str, facts: dict[str, str]) -> None:
        self._notes.put(lambda writer: writer.note(name, facts))

    def _attach(self, key: str, path: str) -> None:
        """Attach the file of a custom module as it is now, once."""
        name, source = trust.attachment(key, path)
        if self._sources.get(name) != source:
            self._sources[name] = source
            self._notes.put(lambda writer: writer.attach(name, source))

    def take(self, topic: Topic, data: bytes, received: int = 0, number: int = 0) -> None:
        """Take one serialised message.

        Args:
            topic: One of the suite's, or one that was added.
            data: The message.
            received: When the middleware received it [ns]; 0: now.
            number: Sequence number by its publisher; 0: not known.
        """
        self._take(self._streams[topic], data, received, number)

    def taker(self, topic: Topic) -> Callable[[bytes, int, int], None]:
        """:meth:`take` for the messages of one topic; faster when called often."""
        return partial(self._take, self._streams[topic])

    def _take(self, stream: TopicStream, data: bytes, received: int, number: int) -> None:
        if self._writer is None:
            if stream.topic.latched:
                self._early.append((stream.topic, data, received, number))
            return
        newest, start = self._newest, self._start
        if stream.stamp_of is not None:
            stamp = stream.stamp_of(data)
            if stamp is None:
                return
            if stream.is_measured:
                stamp += self._age
            if stream.is_log:  # of commands that answer no state: as if of the newest
                stamp = stamp or max(newest, start)
            late = self._end is not None and stamp > self._end and stream.topic.every
            if stamp < start or late:  # a latched message may be from a controller that lags
                return
        elif stream.of_suite and not stream.is_law:
            of_state = next(self._answered) if self._lockstep else stream.received
            stamp = start + of_state * self._loop.period_ns
        else:
            stamp = max(newest, start)
        if stamp > newest and stream.of_suite:
            self._newest = stamp
        stream.count(number)
        if stream.is_state and stamp == self._last_state:
            self._over = True
        log_time = stamp if self._lockstep else max(received or time.time_ns(), start)
        self._last_heard = time.monotonic()
        if self._lockstep and stream.is_law and STATUS in self._suite:
            if self._told:
                return
            log_time, self._law = start, data
        if self._lockstep and stream.is_status:
            self._name_law(log_time, data)
        self._queue.put((stream, log_time, data))

    def _name_law(self, log_time: int, data: bytes) -> None:
        """Write the name of the law of a status, unless it is that of before."""
        status = decoded_status(data)
        self._told |= status is not None
        name = layouts.text_message(status.law) if status else self._law
        if name != self._law:
            self._law = name
            self._queue.put((self._streams[ACTIVE_LAW], log_time, name))

    def several(self, topic: Topic) -> None:
        """Note that a topic has several publishers, whose numbers cannot be told apart."""
        self._streams[topic].several()

    def lost(self, topic: Topic) -> int | None:
        """How many messages are known to be missing; None when nothing is known."""
        stream = self._streams[topic]
        gaps = stream.gaps
        expected = self.expected(topic) if self._over else None  # else it was stopped early
        skips = not self._loop.lockstep and topic in ANSWERS  # a state may stay unanswered
        if expected is None or (skips and stream.received):
            return gaps
        return max(expected - stream.received, gaps or 0)

    def expected(self, topic: Topic) -> int | None:
        """How many messages of a topic the whole motion has; None when that is not known."""
        if self._loop.last_index is None or topic not in self._suite:
            return None
        if topic not in self._expected:
            self._expected[topic] = self._count(topic, self._loop.last_index + 1)
        return self._expected[topic]

    def _count(self, topic: Topic, samples: int) -> int:
        """How many messages of a topic some samples have, less those that hazards leave out."""
        every, table = topic.every, self._table
        if not every:
            return 1
        calm = min(samples, -(-table.undisturbed_from // every) * every)
        rest = (samples - 1) // every - (calm - 1) // every
        if topic in (*TELEMETRY, ANSWERED):
            return len(table.due(calm, every)) + rest
        reception = table.reception(np.arange(0, calm, every))
        left = {
            JOINT_STATES: reception.published,
            COMMANDS: reception.answered,
            POSE: reception.shown,
        }
        return int(left.get(topic, np.ones_like(reception.published)).sum()) + rest

    def complete(self) -> bool:
        """Whether the motion is over and all its messages arrived, or will not come any more."""
        if not self._over:
            return False
        missing = [
            topic
            for topic, stream in self._streams.items()
            if stream.received < (self.expected(topic) or 0)
        ]
        lost = [topic for topic in missing if self._lockstep or topic not in ANSWERS]
        patience = STRAGGLERS if lost else ANSWERS_AFTER
        return not missing or time.monotonic() - self._last_heard > patience

    def close(self) -> list[str]:
        """Write the remaining messages and complete the bag.

        Returns:
            The report: one line a topic with received, written and lost messages.
        """
        self._stop.set()
        if self._writer is None:
            return []
        self._thread.join()
        certificates, counts = self._writer.certificates, self._writer.written
        for topic in self._streams:
            certificates[topic.name] = Certificate(counts[topic.name], self.lost(topic))
        try:
            self._writer.close()
        except OSError as error:
            self._failed(self._broken(error))
        return [
            f'{topic.name}: received {stream.received}, {certificates[topic.name]}'
            for topic, stream in self._streams.items()
        ]

    def _write(self) -> None:
        assert self._writer is not None
        try:
            while True:
                last = self._stop.wait(DRAIN)
                while not self._notes.empty():
                    self._notes.get()(self._writer)
                while not self._queue.empty():
                    stream, log_time, data = self._queue.get()
                    name = stream.topic.name
                    if name not in self._writer.channels:
                        self._writer.add(stream.channel)
                    self._writer.write(name, log_time, data)
                if last:
                    return
                self._writer.flush(FLUSH)
        except OSError as error:
            self._failed(self._broken(error))

    def _broken(self, error: OSError) -> RunError:
        return RunError(f'cannot write {self._directory}: {error.strerror}')
