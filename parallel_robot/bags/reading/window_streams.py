"""The messages of a bag in windows of time, in memory that does not grow with the bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.limits import Allowance
from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot.bags.messages.span import FIRST, LAST, Span
from parallel_robot_model.common.errors import WholeNeededError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import JOINT_STATES, Topic

SLACK = 2 * NANOSECONDS  # ns, by which messages may be logged after states that are newer

Streams = dict[str, list[Samples]]  # by full name of the topic


class Window(NamedTuple):
    """The messages of a window, and those around it that its states need.

    Attributes:
        span: The window.
        streams: The messages.
        preceded: Whether states from before it were read.
    """

    span: Span
    streams: Mapping[str, Sequence[Sequence[Samples]]]
    preceded: bool


def windows(
    bag: Path,
    source: Iterable[tuple[list[tuple[str, list[Samples]]], int | None]],
    topics: Mapping[str, Topic],
    begin: int,
    end_of: Callable[[int], int],
    around: int,
    memory: int,
) -> Iterator[Window]:
    """Iterate over windows that follow each other, by the stamps of the states.

    Messages without a stamp belong to a window by their log times: from that of its first state
    to that of the first state after it. A window without states is one with the next.

    Args:
        bag: The bag, for error messages.
        source: Messages, and the log time up to which all are there by then; None: all.
        topics: Topics by their full names.
        begin: Stamp at which the first window begins [ns].
        end_of: Stamp at which the window of a state ends, by its stamp [ns].
        around: How much before and after a window is needed for it [ns].
        memory: What may be held [bytes].

    Raises:
        BagError: a window takes too much.
        WholeNeededError: the stamps of the states go back beyond it.
    """
    pending: Streams = {}
    span = Span(FIRST, FIRST, FIRST, FIRST)
    for parts, known in source:
        for name, samples in parts:
            late = any((part.stamps < span.end).any() for part in samples)
            if topics[name] == JOINT_STATES and late:
                what = f'the stamps of {JOINT_STATES.name} go back, as in a second run'
                raise WholeNeededError(f'{bag}: {what}: it can be read as a whole alone')
            pending.setdefault(name, []).extend(samples)
        Allowance(bag, 0, memory).hold(_size(pending))
        while found := _span(pending, topics, max(begin, span.end), span.end_heard, end_of, known):
            span = found
            yield _window(pending, topics, span, around)


def _span(
    pending: Streams,
    topics: Mapping[str, Topic],
    begin: int,
    heard: int,
    end_of: Callable[[int], int],
    known: int | None,
) -> Span | None:
    """The window that begins at a stamp, if all of it is there by now; `heard` of the last one."""
    states = [
        part for name, parts in pending.items() for part in parts if topics[name] == JOINT_STATES
    ]
    if not any((part.stamps >= begin).any() for part in states):
        return None
    stamps = np.concatenate([part.stamps for part in states])
    times = np.concatenate([part.log_times for part in states])
    end = end_of(int(stamps[stamps >= begin].min()))
    inside, after = times[(stamps >= begin) & (stamps < end)], times[stamps >= end]
    if not inside.size or (
        known is not None and not (after.size and known >= after.min() + SLACK)
    ):
        return None
    if begin > FIRST and heard == FIRST:
        heard = int(inside.min())
    return Span(begin, end, heard, int(after.min())) if after.size else Span(begin, LAST, heard)


def _window(pending: Streams, topics: Mapping[str, Topic], span: Span, around: int) -> Window:
    """A window; what it and those after it do not need is given up."""
    preceded = False
    for name, parts in pending.items():
        if topics[name] == JOINT_STATES:
            preceded |= any((part.stamps < span.begin).any() for part in parts)
        low = span.begin - around
        older = [part.stamps[part.stamps <= low] for part in parts]
        low = max(
            (int(each.max()) for each in older if each.size), default=low
        )  # the last of them
        since = Span(low, LAST, span.begin_heard - SLACK, LAST)
        pending[name] = _chosen(topics[name], parts, since)
    until = Span(FIRST, span.end + around, FIRST, span.end_heard + SLACK)
    chosen = {name: _chosen(topics[name], parts, until) for name, parts in pending.items()}
    streams = {name: [parts] for name, parts in chosen.items() if parts}
    return Window(span, streams, preceded)


def _chosen(topic: Topic, parts: list[Samples], span: Span) -> list[Samples]:
    """Messages of a part of a run."""
    chosen = []
    for part in parts:
        kept = span.holds(topic, part)
        if kept.all():
            chosen.append(part)
        elif kept.any():
            chosen.append(part.rows(kept))
    return chosen


def _size(pending: Streams) -> int:
    """Bytes of messages."""
    parts = [part for parts in pending.values() for part in parts]
    return sum(
        part.stamps.nbytes + sum(values.nbytes for values in part.numbers.values())
        for part in parts
    )
