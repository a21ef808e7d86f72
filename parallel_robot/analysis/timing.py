"""How a run kept its time, from the bag alone: which torque acted when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.columns import BLOCK, Columns, blocks
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
    # lag of each step in no order [samples], shape (L,); empty when the bag does not say
    lag: NDArray[np.int64]
    # number of steps after the first command whose torque answers no state: in the safe
    # action of the motors, at zero torque in a fault
    uncommanded: int
    # from the sample at which each state is sent to its recording, in no order [s], shape
    # (N,); empty when the stamps are not of the recorder's clock, as in lockstep
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
        p50, p99, largest = np.percentile(
            self.lag, [50, 99, 100], method='inverted_cdf', overwrite_input=True
        )
        return int(p50), int(p99), int(largest)


def evaluate(log: RunLog, history: History) -> Timing:
    """Find out how a run kept its time.

    Args:
        log: The run.
        history: What the bag says besides the motion.
    """
    period = loop_of(log.config).period_ns
    if not history.facts and len(log.stamps) > 1:
        period = int(np.median(np.diff(log.stamps[:BLOCK])))
    planned = int(history.facts.get('start_stamp', 0))
    answers = log.answers
    states = np.zeros(0, np.int64) if answers is None else answers.states[answers.states > 0]
    says = bool(states.size)
    first = planned if planned or not says else int(states.min())
    # Of a motion that was planned every state counts, also where the controller fell silent.
    last = int(states.max()) if says and not planned else log.stamps[-1]
    nodes = history.facts.get('source', NODES) == NODES
    stepped = log.config['time_mode'] == 'lockstep'
    age, delays = reported_age(log.config), Columns('the delays')
    due = answered = gap = near = 0
    for rows in blocks(0, len(log.stamps)):
        stamps = log.stamps[rows]
        count = (stamps + age >= first) & (stamps <= last)
        due += int(count.sum())
        answered += int((count & ~np.isnan(log.answer[rows, 0])).sum()) if says else 0
        gap = max(gap, int(np.diff(log.stamps[max(rows.start - 1, 0) : rows.stop]).max(initial=0)))
        if nodes and not stepped:
            delay = (log.heard[rows] - stamps - age) / NANOSECONDS
            near += int((np.abs(delay) * NANOSECONDS < SAME_CLOCK).sum())
            delays.add({'delay': delay})
    lag, uncommanded = np.zeros(0, np.int64), 0
    if answers is not None and says and log.has_efforts:  # which tell what command acted
        lag, uncommanded = _lags(log, answers, first, period)
    return Timing(
        due,
        answered if says else None,
        period / NANOSECONDS,
        lag,
        uncommanded,
        delays.arrays()['delay'] if 2 * near > len(log.stamps) else np.zeros(0),
        granted_priorities(history),
        gap,
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
        values = 1e3 * np.percentile(timing.delay, [50, 99, 100], overwrite_input=True)
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
    newest_states, age = _accumulated(answers.states), reported_age(log.config)
    # Of some commands, as of the last ones, the bag may not say which state they answer.
    silent = np.clip(log.command[~matching.among(log.command, answers.torque)], -limit, limit)
    lags, at, uncommanded, early, begun = Columns('the lags'), -1, 0, 0, False
    for rows in blocks(1, len(log.stamps)):
        steps = slice(rows.start - 1, rows.stop)
        stamps, effort = log.stamps[steps], log.effort[steps]
        newest = np.searchsorted(newest_states, stamps, side='right') - 1
        since, at = _answered(effort, answers, newest, at, limit)
        if not begun and since.any():
            begun, start = True, int(np.flatnonzero(since)[0])
        else:
            start = 0 if begun else len(since)
        counted = stamps[:-1] >= first
        idle = counted & (since == 0) & ~matching.among(effort[1:], silent)
        early += int(idle[:start].sum())
        since[:start] = first - period
        uncommanded += int(idle[start:].sum())
        known = counted & (since > 0)
        took = (stamps[1:] - since)[known] - age
        lags.add({'lag': np.rint(took / period).astype(np.int64)})
    return (lags.arrays()['lag'], uncommanded) if begun else (np.zeros(0, np.int64), early)


def _accumulated(states: NDArray[np.int64]) -> NDArray[np.int64]:
    """The largest of some stamps and all before it, shape (R,)."""
    found, largest = Columns('the commands'), int(states[0])
    for rows in blocks(0, len(states)):
        part = np.maximum(np.maximum.accumulate(states[rows]), largest)
        largest = int(part[-1])
        found.add({'states': part})
    return found.arrays()['states']


def _answered(
    effort: Array, answers: Answers, newest: NDArray[np.int64], at: int, limit: Array
) -> tuple[NDArray[np.int64], int]:
    """Stamp of the state that the torque of each step answers [ns], 0 for none, shape (N - 1,).

    Args:
        effort: Torques at the states [N m], shape (N, n).
        answers: All answers.
        newest: Index of the last answer to each state or an earlier one, shape (N,).
        at: Index of the answer that acted before; -1: none.
        limit: Of the motors [N m], shape (n,) or ().

    Returns:
        The stamps, and which answer acted last.
    """
    low = max(0, min(int(newest[0]), at if at >= 0 else int(newest[0])) - WINDOW)
    part = slice(low, int(newest[-1]) + 1)
    command = np.clip(answers.torque[part], -limit, limit)
    acting = acting_commands(effort, command, newest - low, at - low if at >= 0 else -1)[1:]
    acted = acting[acting >= 0]
    since = np.zeros(len(acting), np.int64)
    since[acting >= 0] = answers.states[part][acted]
    return since, int(acted[-1]) + low if acted.size else at


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
