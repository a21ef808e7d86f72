"""Reads stamped joint vectors from messages of any publisher, by joint name."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import cdr
from parallel_robot_model.messages.layouts import OWN, joint_message
from parallel_robot_model.messages.topics import Topic

MAX_MESSAGE_BYTES = 1 << 16  # bytes of a message that is looked at; one of 100 joints has 10 000


class JointReader:
    """Reads one topic; learns the byte layout of its publisher from the first message.

    Messages that cannot be used are counted with the reason, never passed on: joints that are
    missing or named twice, fields shorter than the names, values that are not finite, an invalid
    stamp.
    """

    def __init__(
        self,
        topic: Topic,
        joints: tuple[str, ...],
        fields: Sequence[str],
        counts: Counter[str],
        optional: Mapping[str, float] | None = None,
    ) -> None:
        """Prepare to read a topic.

        Args:
            topic: Name and type.
            joints: Names of the joints, in the order in which they are read.
            fields: Names of the fields: position, velocity, acceleration.
            counts: Counts the messages that cannot be used, by reason.
            optional: Fields that a message may lack, and what they are where it does, or has no
                finite number.
        """
        self._topic = topic
        self._joints = joints
        self._fields = fields
        self._counts = counts
        self._optional = optional or {}
        self.problem = ''  # why the last message that could not be used was none
        # byte layout of the last message; None when it was not understood
        self.layout: cdr.Layout | None = None
        self.order = list(range(len(joints)))  # index of each joint in the message
        # Learn the layout that the suite publishes, and import all that reading needs.
        self.read(OWN[topic.type](joints).encode())

    def read(self, data: bytes) -> tuple[int, list[np.ndarray]] | None:
        """Read one message.

        Returns:
            Stamp [ns] and one array of shape (n,) for each field, the optional ones last; None
            for a message that cannot be used.
        """
        records = self.layout.decode(data) if self.layout else None
        if records is None:
            problem = self._learn(data)
            records = self.layout.decode(data) if self.layout and not problem else None
            if records is None:
                self._refuse(problem or 'not understood')
                return None
        vectors = [records[name][0][self.order] for name in self._fields]
        for name, vector in zip(self._fields, vectors, strict=True):
            if not np.isfinite(vector).all():
                self._refuse(f'{name} is not finite')
                return None
        if records['nanosec'][0] >= NANOSECONDS:
            self._refuse('the stamp has more than a second in ns')
            return None
        vectors += [self._read_optional(records, *each) for each in self._optional.items()]
        return int(cdr.stamps_of(records)[0]), vectors

    def _refuse(self, problem: str) -> None:
        self.problem = problem
        self._counts[f'{self._topic.name}: {problem}'] += 1

    def _read_optional(self, records: np.ndarray, name: str, unknown: float) -> np.ndarray:
        if name not in (records.dtype.names or ()):
            return np.full(len(self._joints), unknown)
        values = records[name][0][self.order]
        return np.where(np.isfinite(values), values, unknown)

    def _learn(self, data: bytes) -> str:
        """Set layout and order for messages like this one, or say why it cannot be used."""
        self.layout = None
        if len(data) > MAX_MESSAGE_BYTES:
            return f'longer than {MAX_MESSAGE_BYTES} bytes'
        try:
            names, fields, layout = joint_message(self._topic.type, data)
        except ValueError:
            return 'not a message of its type'
        for joint in self._joints:
            if names.count(joint) != 1:
                return f'{joint} is {"missing" if joint not in names else "named twice"}'
        for name in self._fields:
            if name not in fields:
                return f'{name} is missing or short'
        self.order = [names.index(joint) for joint in self._joints]
        self.layout = layout()
        return ''


# Whose joints a message is of: topics such as ``joint_states`` are shared by several robots.

STAMPED = 12  # bytes of a message up to the end of its stamp
LOOKED_AT = 96  # bytes after it, by which a message is known again


class OurJoints:
    """Tells messages of our robot from those of others, as of a gripper on the same topic."""

    def __init__(self, topic: Topic, joints: tuple[str, ...]) -> None:
        """Prepare for the first message.

        Args:
            topic: Name and type of the topic.
            joints: Names of our joints.
        """
        self._type, self._joints = topic.type, set(joints)
        self._known = b'', 0  # begin and length of the last message that was ours

    def is_foreign(self, data: bytes) -> bool:
        """Whether a message names joints, and none of ours."""
        seen = data[STAMPED : STAMPED + LOOKED_AT], len(data)
        if seen == self._known:
            return False
        if len(data) > MAX_MESSAGE_BYTES:
            return False
        try:
            names, _, _ = joint_message(self._type, data)
        except ValueError:  # who reads it says what is wrong
            return False
        if names and not self._joints & set(names):
            return True
        self._known = seen
        return False


# Tells by the numbers of its messages whether the trusted publisher of a topic sent a message.

SILENCE = 0.5  # s, of the trusted publisher, until another one is trusted: no stall is as long
PERIODS = 3  # of the trusted publisher, likewise, where they are longer
RUN = 3  # messages in a row of another publisher, until it is trusted
SETTLED = 1.0  # s without a change of publisher, after which a topic has one publisher
WINDOW = 0.5  # s, over which the rate of a publisher is averaged, and what it owes forgotten
SLACK = 2  # numbers by which a publisher may always be ahead of its last message: a loss
FASTER = 1.5  # times its rate: what it may have sent meanwhile


class _Stream:
    """Messages whose numbers follow each other, as those of one publisher do."""

    def __init__(self, number: int, now: float, rate: float) -> None:
        # number: number of the last one that can be no other publisher's; last_time: time of
        # the last one that can be its [s]; rate: messages in a second, on average; after
        # one message, those that are assumed; run: messages in a row
        self.number, self.last_time, self.rate, self.run = number, now, rate, 1
        self._time = now  # s, of the last one that can be no other publisher's
        self._owed = 0.0  # messages that were due and have not come: they may come at once
        self._first, self._since, self._measured = number, now, False  # of the average

    def follows(self, number: int, now: float) -> bool:
        """Whether a message can be of this publisher."""
        rate = FASTER * self.rate if self.run > 1 else self.rate
        sent = self._owed + rate * (now - self._time)
        return 0 < number - self.number <= SLACK + sent

    def may_send(self, number: int, now: float) -> bool:
        """Whether a message may be of this publisher, if it still publishes."""
        if now - self.last_time < max(SETTLED, self.pause):
            return self.follows(number, now)
        return 0 < number - self.number <= SLACK

    @property
    def pause(self) -> float:
        """Some of its periods [s]; 0 if not known."""
        return PERIODS / self.rate if self.rate else 0.0

    def take(self, number: int, now: float) -> None:
        """Note a message that can be no other publisher's."""
        passed = now - self._time
        remaining = self._owed * (1.0 - passed / WINDOW) if passed < WINDOW else 0.0
        owed = remaining + self.rate * passed - (number - self.number)
        self._owed = owed if owed > 0.0 else 0.0
        self.number, self.last_time, self._time = number, now, now
        self.run += 1
        elapsed = now - self._since
        if elapsed > WINDOW or not self._measured:
            self.rate = (number - self._first) / max(elapsed, 1e-6)
            if elapsed > WINDOW:
                self._first, self._since, self._measured = number, now, True


class SinglePublisher:
    """Watches the numbers of the messages of a topic, at any rate.

    The middleware numbers the messages of each publisher one by one, and does not say whose they
    are. The publisher that sends first is trusted. A message that cannot be its next one is of an
    unknown publisher; one that may be either's is not used. Another publisher is trusted when the
    trusted one has been silent for a while, and the other's numbers follow each other. Numbers
    may be missing: those messages were lost. Without numbers, nothing is noticed.
    """

    def __init__(
        self, alone: Callable[[], bool], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Prepare for the first message.

        Args:
            alone: Whether the topic has one publisher now, as far as the middleware knows: one
                that was killed counts for 20 s, one that has just ended does not count.
            clock: Gives the time [s].
        """
        self._alone, self._clock = alone, clock
        self.lost = 0  # messages of the trusted publisher that were sent and did not come
        # s, for which the trusted one had been silent when another was heard last
        self.silence = 0.0
        self._trusted: _Stream | None = None
        self._other: _Stream | None = None  # the unknown publisher that sent last
        self._last = 0  # number of the last message, whosever
        self._interrupted = False  # whether another one sent after the trusted one
        self._alternated_at = (
            -math.inf
        )  # s, when a publisher was last heard again after another one
        self._several = False  # whether that was twice within SETTLED

    def several(self) -> bool:
        """Whether publishers take turns: twice within a second, and just now."""
        return self._several and self._clock() - self._alternated_at < SETTLED

    def contradicted(self, shared: bool) -> bool:
        """Whether a message that was not used is known to be of a second publisher.

        Else it came while that was still to be found, or after many that were lost.

        Args:
            shared: Whether others, whose messages are recognised by their content, publish there,
                too.
        """
        return self.several() or (self._trusted is not None and not shared)

    def is_unknown(self, number: int) -> bool:
        """Whether a message may be of another publisher, so that it must not be used.

        Args:
            number: Its number, which its publisher counts from 1 on; 0: not known.
        """
        trusted, other, last = self._trusted, self._other, self._last
        if not number:
            return trusted is not None
        now = self._clock()
        self._last = number
        if trusted is not None and trusted.follows(number, now):
            if other is None or not other.may_send(number, now) or self._alone():
                self.lost += number - trusted.number - 1
                trusted.take(number, now)
                if self._interrupted:
                    self._interrupted = False
                    self._note_alternation(now)
                return False
            trusted.last_time = now
            if number <= last:
                other.last_time, other.run = now, max(2, other.run)
                self._note_alternation(now)
            return True
        self.silence = now - trusted.last_time if trusted is not None else 0.0
        if self._is_to_be_trusted(number, last, now):
            self._trusted, self._other, self._interrupted = self._other, None, False
            return False
        self._interrupted = True
        return True

    def _is_to_be_trusted(self, number: int, last: int, now: float) -> bool:
        """Note a message that is not of the trusted publisher; whether its own is from now on."""
        trusted, other, alone = self._trusted, self._other, self._alone()
        silence = SILENCE if alone or trusted is None else max(SILENCE, trusted.pause)
        if other is not None and other.follows(number, now):
            if now - other.last_time > silence and not alone:
                other.run = 0  # a command now and then is no stream of commands
            other.take(number, now)
        else:
            if other is not None and number <= last and not self._is_publishing(now):
                self._note_alternation(now)
            other = self._other = _Stream(number, now, trusted.rate if trusted else 0.0)
            if trusted is not None and 0 <= trusted.number - number <= SLACK:
                other.run = 2  # so near that the next one may be taken for the trusted one's
            if alone and (trusted is None or number > trusted.number):
                return True  # the first message, or one after many that were lost
        if trusted is None:
            return alone or other.run >= RUN
        return other.run >= RUN and now - trusted.last_time >= silence

    def _is_publishing(self, now: float) -> bool:
        return self._trusted is not None and now - self._trusted.last_time < SILENCE

    def _note_alternation(self, now: float) -> None:
        self._several = now - self._alternated_at < SETTLED
        self._alternated_at = now
