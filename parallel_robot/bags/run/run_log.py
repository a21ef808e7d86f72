"""A run as time-aligned arrays, and parts of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.messages.message_arrays import WHOLE, Samples, Span
from parallel_robot.bags.run.matching import Answers, Used
from parallel_robot.bags.run.two_sources import Contradiction
from parallel_robot_control.contract import JointReference
from parallel_robot_model.common.errors import BagError, WholeNeededError
from parallel_robot_model.common.units import JointUnits
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import SLOW, TELEMETRY, Topic
from parallel_robot_model.robots.registry import units_of

# How many messages of each topic a bag holds, and how many it lacks.


@dataclass(frozen=True)
class TopicCount:
    """Messages of a topic."""

    count: int  # how many the bag holds
    # how many were published between the first and the last one and are not there. A state
    # that the controller left out has no command and no telemetry: none is missing
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


EMPTY = np.zeros((0, 0))


class RunLog(NamedTuple):
    """A recorded run with one row for each state, the reference at the stamp of the state."""

    scenario: str  # name of the scenario
    law: str  # name of the law
    joints: tuple[str, ...]  # names of the actuated joints
    config: dict[str, Any]  # the resolved configuration
    start_stamp: int  # stamp of t = 0 [ns]
    stamps: np.ndarray  # stamps of the states [ns], shape (N,)
    time: np.ndarray  # stamps since t = 0 [s], shape (N,)
    position: np.ndarray  # measured actuated angles [rad], shape (N, n)
    # measured actuated rates, NaN where the bag has none [rad/s], shape (N, n)
    velocity: np.ndarray
    # torques applied during the step that ended at the stamp; those commanded where the bag
    # has none [N m], shape (N, n)
    effort: np.ndarray
    reference_position: np.ndarray  # desired angles [rad], shape (N, n)
    reference_velocity: np.ndarray  # desired rates [rad/s], shape (N, n)
    reference_acceleration: np.ndarray  # desired accelerations [rad/s^2], shape (N, n)
    command: np.ndarray  # commanded torques in the order of the messages [N m], shape (M, n)
    messages: dict[str, TopicCount]  # counts per topic, by name without leading slash
    # command that answered each state [N m], NaN where there is none, shape (N, n)
    answer: np.ndarray = EMPTY
    heard: np.ndarray = EMPTY  # log times of the states [ns], shape (N,)
    # the commands with the states that they answer; None where the bag does not say
    answers: Answers | None = None
    used: Used | None = None  # references that the controller used; None in bags that do not say
    has_efforts: bool = True  # whether the torques were measured, as far as the robot does
    warnings: tuple[str, ...] = ()  # what is wrong with the bag, one line each
    # whether a state has a reference of its time, as the controller sees it; without one it
    # has no error, shape (N,)
    referenced: np.ndarray = EMPTY
    # whether the bag does not say of which robot it is: nothing is written into it that
    # nobody asked for
    foreign: bool = False
    # how joints differ from their references, and efforts from the commands; in the warnings, too
    joints_differ: Contradiction = Contradiction()
    efforts_differ: Contradiction = Contradiction()

    @property
    def units(self) -> JointUnits:
        """Units of the joints, those of hinges where the robot is not known."""
        return units_of(self.config)

    @property
    def values(self) -> dict[str, Any]:
        """The resolved configuration, as a run of the notebook calls it."""
        return self.config

    @property
    def has_velocities(self) -> bool:
        """Whether the rates of the joints were measured."""
        return not np.isnan(self.velocity).any()

    @property
    def kind(self) -> tuple[bool, bool, bool]:
        """Whether it has efforts, velocities, and the references that were used."""
        return self.has_efforts, self.has_velocities, self.used is not None


def with_acting_commands(log: RunLog) -> RunLog:
    """A run whose efforts, where they are no commands, do not tell which command acted."""
    return log._replace(has_efforts=log.has_efforts and not log.efforts_differ.text)


def between(bag: Path, log: RunLog, start: float | None, stop: float | None) -> RunLog:
    """The states of a part of a run, with all its commands.

    Args:
        bag: The bag, for error messages.
        log: The run.
        start: From which time on [s]; None: from the first state.
        stop: Up to which [s]; None: to the last one.

    Raises:
        BagError: there is no state in it.
    """
    if start is None and stop is None:
        return log
    chosen = within(log.time, start, stop)
    if not len(chosen):
        raise BagError(no_state(bag, float(log.time.min()), float(log.time.max())))
    if chosen[-1] - chosen[0] + 1 == len(chosen):
        return rows(log, slice(chosen[0], chosen[-1] + 1))  # a view, also of a long run
    return rows(log, chosen)


def no_state(bag: Path, first: float, last: float) -> str:
    """That a part has no state of a bag whose states go from one time to another [s], in words."""
    ends = f'from t = {first:.3f} s to {last:.3f} s'
    return f'{bag} has no state between --from and --to: its states go {ends}'


def within(time: np.ndarray, start: float | None, stop: float | None) -> np.ndarray:
    """Numbers of the states from one time to another [s]."""
    since, until = (-np.inf if start is None else start), (np.inf if stop is None else stop)
    return np.flatnonzero((time >= since) & (time <= until))


def head(log: RunLog, count: int) -> RunLog:
    """The first states of a run, with all its commands."""
    return rows(log, np.arange(count))


def with_reference(log: RunLog) -> RunLog:
    """The states of a run that have a reference of their time, with all its commands."""
    if log.referenced.all():
        return log
    return rows(log, np.flatnonzero(log.referenced))


def rows(log: RunLog, chosen: slice | np.ndarray) -> RunLog:
    """Some states of a run, by their numbers in order, with all its commands."""
    kept: dict[str, Any] = {
        name: value[chosen]
        for name, value in log._asdict().items()
        if name != 'command' and isinstance(value, np.ndarray) and len(value)
    }
    used = log.used
    if used is not None:
        used = used.rows(np.arange(len(log.stamps))[chosen])
    return log._replace(**kept, used=used)


def joined(first: RunLog, second: RunLog) -> RunLog:
    """A part of a run and the next one; with the commands of the next one.

    Raises:
        WholeNeededError: they are of another kind.
    """
    if first.kind != second.kind:
        raise WholeNeededError('the parts of the bag do not hold the same')
    both: dict[str, Any] = {
        name: np.concatenate([value, getattr(second, name)])
        for name, value in first._asdict().items()
        if name != 'command' and isinstance(value, np.ndarray)
    }
    used = second.used
    if first.used is not None and used is not None:
        one = first.used
        used = Used(
            np.concatenate([one.stamps, used.stamps]),
            np.concatenate([one.acts, used.acts]),
            np.concatenate([one.late, used.late]),
            np.concatenate([one.older, len(one.stamps) + used.older]),
            JointReference(*map(np.concatenate, zip(one.samples, used.samples, strict=True))),
        )
    return second._replace(**both, used=used)
