"""How a run kept its time, from the bag alone: which torque acted when."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.experiment import NODES
from parallel_robot.bags.history import History, granted_priorities
from parallel_robot.bags.run import matching
from parallel_robot.bags.run.matching import Answers
from parallel_robot.bags.run.run_log import RunLog, TopicCount
from parallel_robot_control.joint_states import MISSING, of_missing
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import internal, kernel
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.messages import topics
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.plant import PlantParameters

# Real time is held up to these: a little beyond, the metrics of some law change (docs/bags.md).
ANSWERED = 0.9  # smallest share of the states that are answered
LAG_P50 = 2, 0.002  # largest median of the lag: samples or [s], whichever is longer
LAG_P99 = 2, 0.005  # the same for the 99th percentile
LAG_MAX = 4, 0.02  # the same for the maximum
WINDOW = 2000  # commands that are searched for that of a step
SAME_CLOCK = NANOSECONDS  # ns, between stamps and log times of a loop in wall time


class Timing(NamedTuple):
    """How a run kept its time.

    The lag of a step is the time from the state that its torque answers to the end of the step,
    without the age of the state where its stamp tells that. One sample is ideal: the torque
    computed from state k acts from k to k + 1. A step before the first command counts as one that
    answers the state before the first.
    """

    states: int  # number of states that were to be answered
    answered: int | None  # number of states that were answered; None if the bag does not say
    period: float  # period of the loop [s]
    # lag of each step [samples], shape (L,); empty when the bag does not say. Of a bag that
    # is read in windows, its percentiles from 1 to 100
    lag: NDArray[np.int64]
    # number of steps after the first command whose torque answers no state: in the safe
    # action of the motors, at zero torque in a fault
    uncommanded: int
    # from the sample at which each state is sent to its recording [s], shape (N,); empty
    # when the stamps are not of the recorder's clock, as in lockstep. Of a bag that is read
    # in windows, its percentiles from 0 to 100
    delay: NDArray[np.float64]
    # node to the real-time priority that it was granted, where the bag says so
    priority: dict[str, str]
    gap: int = 0  # longest step from a state to the next [ns]

    @property
    def skipped(self) -> int | None:
        """Number of states without an answer; None if the bag does not say."""
        return None if self.answered is None else self.states - self.answered

    @property
    def realtime(self) -> bool | None:
        """Whether real time was held; None in lockstep and simulations, or if not known.

        It was when at least ANSWERED of the states were answered and median, 99th percentile and
        maximum of the lag are at most LAG_P50, LAG_P99 and LAG_MAX.
        """
        if self.answered is None or not self.delay.size or not self.lag.size:
            return None
        enough = self.answered >= ANSWERED * self.states
        bounds = zip(self.lag_percentiles(), (LAG_P50, LAG_P99, LAG_MAX), strict=True)
        return enough and all(
            lag <= max(samples, round(seconds / self.period)) for lag, (samples, seconds) in bounds
        )

    def lag_percentiles(self) -> tuple[int, int, int]:
        """Median, 99th percentile and maximum of the lag [samples], none interpolated."""
        p50, p99, largest = np.percentile(self.lag, [50, 99, 100], method='inverted_cdf')
        return int(p50), int(p99), int(largest)


def evaluate(log: RunLog, history: History) -> Timing:
    """Find out how a run kept its time.

    Args:
        log: The run.
        history: What the bag says besides the motion.
    """
    period = loop_of(log.config).period_ns
    if not history.facts:
        period = int(np.median(np.diff(log.stamps))) if len(log.stamps) > 1 else period
    told = int(history.facts.get('start_stamp', 0))
    answers = log.answers
    states = np.zeros(0, np.int64) if answers is None else answers.states[answers.states > 0]
    says = bool(states.size)
    first = told if told or not says else int(states.min())
    # Of a motion that was planned every state counts, also where the controller fell silent.
    last = int(states.max()) if says and not told else log.stamps[-1]
    due = (log.stamps + reported_age(log.config) >= first) & (log.stamps <= last)
    answered = int((~np.isnan(log.answer[due, 0])).sum()) if says else None
    lag, uncommanded = np.zeros(0, np.int64), 0
    if answers is not None and says and log.has_efforts:  # which tell what command acted
        lag, uncommanded = _lags(log, answers, first, period)
    delay = (log.heard - log.stamps - reported_age(log.config)) / NANOSECONDS
    nodes = history.facts.get('source', NODES) == NODES
    stepped = log.config['time_mode'] == 'lockstep'
    wall = nodes and not stepped and np.median(np.abs(delay)) * NANOSECONDS < SAME_CLOCK
    return Timing(
        int(due.sum()),
        answered,
        period / NANOSECONDS,
        lag,
        uncommanded,
        delay if wall else delay[:0],
        granted_priorities(history),
        int(np.diff(log.stamps).max(initial=0)),
    )


def verdict(timing: Timing) -> str:
    """Whether real time was held, in one line; empty where Timing.realtime is None."""
    if timing.realtime is None:
        return ''
    _, p99, largest = timing.lag_percentiles()
    if timing.realtime:
        return f'real time: held (lag p99 {p99} sample{"s" if p99 > 1 else ""})'
    left = f'{_percent(timing.skipped or 0, timing.states)} of the states unanswered, '
    return (
        f'real time: not held, the machine was busy: {left if timing.skipped else ""}'
        f'lag up to {1e3 * largest * timing.period:.3g} ms; the metrics below are of the machine, '
        'not of the law: use --time-mode lockstep'
    )


def remarks(timing: Timing, history: History) -> list[str]:
    """Lines on torques other than those of the law in a run that held real time."""
    if not timing.realtime:
        return []
    lines = []
    if timing.uncommanded:
        lines.append(
            f'real time was held, but in {timing.uncommanded} steps the torque answered no state: '
            "safe action of the motors (plant.command_timeout) or the controller's zero"
        )
    if any(status.fault != NO_FAULT for status in history.statuses):
        lines.append('real time was held, but the controller was in a fault')
    return lines


def never_sent(timing: Timing, counts: Mapping[str, TopicCount], history: History) -> list[str]:
    """A line on states that were never sent to a loop in wall time, with the likely cause.

    Args:
        timing: How the run kept its time.
        counts: Messages by topic, see :func:`run_log.count`.
        history: What the bag says besides the motion.
    """
    states = counts.get(topics.JOINT_STATES.name, TopicCount(0, 0))
    due = states.count + states.missing
    missing = states.missing - history.lost.get(f'/{topics.JOINT_STATES.name}', 0)
    if not timing.delay.size or missing <= MISSING * due:
        return []
    return [of_missing(missing, due, timing.gap, False)]


def as_json(timing: Timing) -> dict[str, Any]:
    """How a run kept its time as plain data; None for what the bag does not say."""
    p50, p99, largest = (None, None, None)
    if timing.lag.size:
        p50, p99, largest = (1e3 * lag * timing.period for lag in timing.lag_percentiles())
    delay = {}
    if timing.delay.size:
        values = 1e3 * np.percentile(timing.delay, [50, 99, 100])
        delay = dict(zip(('p50', 'p99', 'max'), values.tolist(), strict=True))
    return {
        'states': timing.states,
        'answered': timing.answered,
        'skipped': timing.skipped,
        'lag_p50_ms': p50,
        'lag_p99_ms': p99,
        'lag_max_ms': largest,
        'uncommanded': timing.uncommanded,
        'longest_gap_s': timing.gap / NANOSECONDS,
        **{f'delay_{name}_ms': value for name, value in delay.items()},
        'realtime': timing.realtime,
        'priority': timing.priority,
    }


def _percent(part: int, whole: int) -> str:
    share = 100.0 * part / whole
    return f'{share:.0f} %' if share >= 1.0 else f'{share:.1g} %'


def _lags(log: RunLog, answers: Answers, first: int, period: int) -> tuple[NDArray[np.int64], int]:
    """Lag of each step after a stamp [ns], in samples, and the number of steps without one."""
    limit = np.array(group(log.config, PlantParameters, 'plant').torque_limit)
    command = np.clip(answers.torque, -limit, limit)
    stamps = np.maximum.accumulate(answers.states)
    newest = np.searchsorted(stamps, log.stamps, side='right') - 1
    acting = acting_commands(log.effort, command, newest, -1)[1:]
    since = np.where(acting < 0, 0, answers.states[acting])
    age = reported_age(log.config)
    counted = log.stamps[:-1] >= first
    if since.any():
        since[: np.flatnonzero(since)[0]] = first - period
    known = counted & (since > 0)
    took = (log.stamps[1:] - since)[known] - age
    lag = np.rint(took / period).astype(np.int64)
    # Of some commands, as of the last ones, the bag may not say which state they answer.
    silent = log.command[~matching.among(log.command, answers.torque)]
    told = matching.among(log.effort[1:], np.clip(silent, -limit, limit))
    return lag, int((counted & (since == 0) & ~told).sum())


@kernel
def acting_commands(
    effort: NDArray[np.float64], command: NDArray[np.float64], newest: NDArray[np.int64], at: int
) -> NDArray[np.int64]:
    """Find the command whose torque acted in the step that ended at each state; -1: none.

    Commands act in their order. Where several have the same torque (saturation, zero), the command
    after that of the previous step is preferred, then the same command again, then a later one.

    Args:
        effort: Torques that acted [N m], shape (N, n).
        command: Commands within the limits of the motors [N m], shape (M, n).
        newest: Index of the last command that answers each state or an earlier one, shape (N,).
        at: Index of the command that acted before; -1: none.
    """
    acting = np.full(len(effort), -1)
    for earlier in range(newest[0], max(-1, newest[0] - WINDOW) if at < 0 else newest[0], -1):
        if len(effort) > 1 and _same(effort[1], command[earlier]):  # of a part of a run
            at = earlier
            break
    for k in range(1, len(effort)):
        last = newest[k - 1]
        found = -1
        if at + 1 <= last and _same(effort[k], command[at + 1]):
            found = at + 1
        elif at >= 0 and _same(effort[k], command[at]):
            found = at
        else:
            for later in range(max(at + 2, last + 1 - WINDOW), last + 1):
                if _same(effort[k], command[later]):
                    found = later
                    break
        if found >= 0:
            acting[k] = at = found
    return acting


@internal
def _same(some: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    same = True
    for i in range(len(some)):
        same = same and some[i] == others[i]
    return same


# Percentiles of numbers of which there may be too many to be kept.

EXACT = 1 << 20  # numbers that are kept; of more, percentiles are within WIDTH / 2 of the number
WIDTH = 1e-3  # of a class, relative to its numbers
LEAST = 1e-12  # magnitude below which a number counts as zero


class Quantiles:
    """Percentiles as of :func:`numpy.percentile`: exact of up to EXACT numbers."""

    def __init__(self) -> None:
        self._kept: list[Array] = []
        self._classes: Counter[int] = Counter()
        self._ends = (math.inf, -math.inf)
        self.count = 0

    def add(self, numbers: Array) -> None:
        """Take numbers, shape (N,)."""
        if not len(numbers):
            return
        self.count += len(numbers)
        self._ends = (
            min(self._ends[0], float(numbers.min())),
            max(self._ends[1], float(numbers.max())),
        )
        self._kept.append(numbers)
        if self.count > EXACT:
            for some in self._kept:
                self._classes.update(_counted(some))
            self._kept = []

    def at(self, percentages: Iterable[float]) -> Array:
        """The percentiles, interpolated; shape as that of the percentages."""
        asked = np.asarray([*percentages], np.float64)
        if self.count <= EXACT:
            return np.percentile(np.concatenate(self._kept), asked)
        classes = sorted(self._classes)
        ends = np.cumsum([self._classes[k] for k in classes])
        values = np.array([_middle(k) for k in classes])
        ranks = (self.count - 1) * (asked / 100.0)
        below = np.floor(ranks)
        low, high = (
            values[np.searchsorted(ends, np.minimum(each, self.count - 1), side='right')]
            for each in (below, below + 1)
        )
        between: Array = np.clip(low + (ranks - below) * (high - low), *self._ends)
        between[asked == 100.0] = self._ends[1]
        between[asked == 0.0] = self._ends[0]
        return between


def counted(counts: Counter[int], percentages: Iterable[float]) -> NDArray[np.int64]:
    """Percentiles of whole numbers that were counted, none interpolated."""
    numbers = sorted(counts)
    ends = np.cumsum([counts[number] for number in numbers])
    ranks = [max(math.ceil(ends[-1] * (asked / 100.0)), 1) for asked in percentages]
    return np.array(numbers, np.int64)[np.searchsorted(ends, ranks)]


def _counted(numbers: Array) -> dict[int, int]:
    """How many numbers are of each class."""
    sizes = np.log(np.maximum(np.abs(numbers), LEAST) / LEAST) / math.log1p(WIDTH)
    classes, counts = np.unique(
        np.sign(numbers).astype(np.int64) * (sizes.astype(np.int64) + 1), return_counts=True
    )
    return dict(zip(classes.tolist(), counts.tolist(), strict=True))


def _middle(number: int) -> float:
    """The middle of a class."""
    size = LEAST * math.exp((abs(number) - 0.5) * math.log1p(WIDTH))
    return math.copysign(size, number) if number else 0.0
