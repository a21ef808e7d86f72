"""Where two bags differ, topic by topic."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.limits import MEMORY, Allowance
from parallel_robot.bags.run_log import RunLog

OBJECT = 200  # bytes that a message takes beside its own


def size(log: RunLog, other: RunLog) -> str:
    """How large the difference of two runs is, as far as both go."""
    pairs = ((log.position, other.position), (log.command, other.command))
    counts = [min(map(len, pair)) for pair in pairs]
    apart = [abs(one[:n] - two[:n]) for (one, two), n in zip(pairs, counts, strict=True)]
    angle, torque = (np.max(each, initial=0.0, where=~np.isnan(each)) for each in apart)
    return f'joints by up to {angle:.2g} rad, commands by up to {torque:.2g} N m'


class _Difference(NamedTuple):
    """Where two streams part: time [ns], topic and what is there."""

    log_time: int
    topic: str
    what: str


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
    first, second = _streams(bag, memory, until), _streams(other, memory, until)
    found = []
    for topic in sorted({*first, *second}):
        pair = first.get(topic, []), second.get(topic, [])
        for (time, data), (other_time, other_data) in zip(*pair, strict=False):
            if (time, data) != (other_time, other_data):
                what = 'another time' if data == other_data else 'other bytes'
                found.append(_Difference(time, topic, what))
                break
        else:
            longer = max(pair, key=len)
            shared = min(map(len, pair))
            if len(longer) > shared:
                what = f'{len(pair[0])} messages, now {len(pair[1])}'
                found.append(_Difference(longer[shared][0], topic, what))
    count = sum(map(len, first.values()))
    if not found:
        return count, ''
    earliest = min(found)
    start = min(stream[0][0] for stream in first.values() if stream)
    return count, (
        f'first on {earliest.topic} at t = {(earliest.log_time - start) / 1e9:.3f} s: '
        f'{earliest.what}; {len(found)} topics differ'
    )


def _streams(
    bag: str | Path, memory: int, until: int | None
) -> dict[str, list[tuple[int, bytes]]]:
    """Time and bytes of all messages by topic, up to a log time."""
    reader, allowance = BagReader(bag, memory), Allowance(Path(bag), 0, memory)
    streams: dict[str, list[tuple[int, bytes]]] = {}
    for message in reader.messages(reader.topics, reader.start):
        if until is not None and message.log_time > until:
            continue
        allowance.hold(OBJECT + len(message.data))
        streams.setdefault(message.topic, []).append((message.log_time, message.data))
    reader.close()
    return streams
