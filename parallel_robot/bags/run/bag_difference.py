"""Where two bags differ, topic by topic."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from parallel_robot.bags.indexed_reader import BagReader, RecordedMessage
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recording
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.run.recording import Recording
from parallel_robot_model.common.errors import WholeNeededError
from parallel_robot_model.common.units import HINGES, Array, JointUnits


def size(bag: Path, other: Path, memory: int = MEMORY) -> str:
    """How large the difference of two runs is, state by state, with their answers.

    Args:
        bag: A bag.
        other: Another.
        memory: What may be held of each at once [bytes].

    Raises:
        BagError: one is not of a run, or takes too much.
    """
    both = (bag, other)
    try:
        largest = _apart(*(recording.chunks(each, SECONDS, memory=memory) for each in both))
    except WholeNeededError:
        largest = _apart(*(iter([recording.read(each, memory=memory)]) for each in both))
    (angle, torque), units = largest
    rad, nm = units.of('rad'), units.of('N m')
    return f'joints by up to {angle:.2g} {rad}, commands by up to {torque:.2g} {nm}'


def _apart(one: Iterator[Recording], two: Iterator[Recording]) -> tuple[list[float], JointUnits]:
    """Largest difference of joints and of commands, by their numbers, and their units."""
    largest, units = [0.0, 0.0], HINGES
    left: list[list[list[Array]]] = [[[], []], [[], []]]  # of both, what the other has not yet
    for windows in zip(one, two, strict=False):
        units = windows[0].log.units
        for found, kept in zip(windows, left, strict=True):
            for parts, values in zip(kept, (found.log.position, found.log.answer), strict=True):
                parts.append(values)
        for k, pair in enumerate(zip(*left, strict=True)):
            first, second = (np.concatenate(parts) for parts in pair)
            count = min(len(first), len(second))
            apart = np.abs(first[:count] - second[:count])
            most = np.max(apart, initial=0.0, where=~np.isnan(apart))
            largest[k] = max(largest[k], float(most))
            for kept, values in zip(left, (first, second), strict=True):
                kept[k] = [values[count:]]
    return largest, units


def compare(
    bag: str | Path, other: str | Path, memory: int = MEMORY, until: int | None = None
) -> tuple[int, str]:
    """Compare two bags topic by topic, message by message.

    Args:
        bag: A bag.
        other: Another.
        memory: What may be held of them [bytes].
        until: Log time up to which they are compared [ns]; None: to their ends.

    Returns:
        How many messages the first has, and the first difference in words; empty without one.

    Raises:
        BagError: one cannot be read to its end, or takes too much.
    """
    pairs: dict[str, _Pair] = {}
    both = [_messages(side, path, memory, until) for side, path in enumerate((bag, other))]
    start: int | None = None
    for side, message in heapq.merge(*both, key=lambda item: item[1].log_time):
        pairs.setdefault(message.topic, _Pair()).take(side, message)
        if side == 0 and start is None:
            start = message.log_time
    found = [
        (difference[0], topic, difference[1])
        for topic, pair in pairs.items()
        if (difference := pair.difference()) is not None
    ]
    count = sum(pair.counts[0] for pair in pairs.values())
    if not found:
        return count, ''
    earliest, topic, what = min(found)
    time = 0.0 if start is None else (earliest - start) / 1e9
    return count, f'first on {topic} at t = {time:.3f} s: {what}; {len(found)} topics differ'


class _Pair:
    """The messages of a topic in both bags, as they come in the order of their log times."""

    def __init__(self) -> None:
        self.counts = [0, 0]  # how many came from each
        self._alone: deque[RecordedMessage] = deque()  # without their like so far, of one side
        self._side = 0
        self._found: tuple[int, str] | None = None

    def take(self, side: int, message: RecordedMessage) -> None:
        """Take a message of a side."""
        self.counts[side] += 1
        if self._found:
            return
        if self._alone and side != self._side:
            like = self._alone.popleft()
            if (like.log_time, like.data) != (message.log_time, message.data):
                what = 'another time' if like.data == message.data else 'other bytes'
                first = message if side == 0 else like
                self._found = first.log_time, what
        # After one whose like did not come at its time, the others say nothing.
        elif not self._alone or message.log_time == self._alone[0].log_time:
            self._side = side
            self._alone.append(message)

    def difference(self) -> tuple[int, str] | None:
        """Time [ns] of the first difference, and what it is; None without one."""
        if self._found or not self._alone:
            return self._found
        return self._alone[0].log_time, f'{self.counts[0]} messages, now {self.counts[1]}'


def _messages(
    side: int, bag: str | Path, memory: int, until: int | None
) -> Iterator[tuple[int, RecordedMessage]]:
    """All messages up to a log time, each with the side that it is of."""
    reader = BagReader(bag, memory)
    for message in reader.messages(reader.topics, reader.start, until):
        yield side, message
    reader.close()
