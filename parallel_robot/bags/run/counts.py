"""How many messages of each topic a bag holds, and how many it lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from parallel_robot.bags.messages.message_arrays import WHOLE, Samples, Span
from parallel_robot.bags.run.matching import Answers
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import SLOW, TELEMETRY, Topic


@dataclass(frozen=True)
class TopicCount:
    """Messages of a topic.

    Attributes:
        count: How many the bag holds.
        missing: How many were published between the first and the last one and are not there. A
            state that the controller left out has no command and no telemetry: none is missing.
    """

    count: int
    missing: int


def count(
    streams: Mapping[Topic, Sequence[Samples]],
    period: int,
    answered: Answers | None,
    states_period: int,
    span: Span = WHOLE,
) -> dict[str, TopicCount]:
    """Count the messages of each topic.

    Args:
        streams: Messages of each topic.
        period: Control period [ns].
        answered: What the controller recorded. None, or not all of it: a command is taken to
            answer each state.
        states_period: From a joint state to the next [ns].
        span: The messages that count; those before it show what is missing at its begin.
    """
    counts: dict[str, TopicCount] = {}
    for topic, parts in streams.items():
        stamps = np.sort(np.concatenate([part.stamps for part in parts]))
        held = sum(int(span.holds(topic, part).sum()) for part in parts)
        missing = 0
        if topic == topics.COMMANDS and (answered is None or _within(answered.gaps, span)):
            states = counts[topics.JOINT_STATES.name]
            missing = max(0, states.count + states.missing - held)
        elif topic == topics.COMMANDS and answered is not None:
            missing = _within(answered.lost, span)
        elif topic == topics.ANSWERED and answered is not None:
            missing = _within(answered.gaps, span)
        elif topic in TELEMETRY and answered is not None and len(stamps):
            due = _due(answered, period)
            due = due[(due > stamps[0]) & (due < stamps[-1])]
            due = due[(due >= span.begin) & (due < span.end)]
            missing = int((~np.isin(due, stamps)).sum())
        elif topic.every:
            each = states_period if topic == topics.JOINT_STATES else topic.every * period
            inside = (stamps[1:] >= span.begin) & (stamps[1:] < span.end)
            steps = np.diff(stamps)[inside] / each
            missing = int(np.maximum(np.rint(steps) - 1, 0).sum())
        counts[topic.name] = TopicCount(held, missing)
    return counts


def _due(answered: Answers, period: int) -> np.ndarray:
    """Stamps at which telemetry was due: the first answer of each SLOW samples."""
    known = answered.states > 0
    acts = answered.acts[known] // (SLOW * period)
    return answered.states[known][1:][np.diff(acts) != 0]


def _within(log_times: np.ndarray, span: Span) -> int:
    """How many places are in a part of a run, by log times [ns]."""
    return int(((log_times >= span.begin_heard) & (log_times < span.end_heard)).sum())
