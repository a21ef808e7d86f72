"""How a run of any length kept its time, window by window."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis.timing import SAME_CLOCK, Quantiles, Timing, acting_commands, counted
from parallel_robot.bags.experiment import NODES
from parallel_robot.bags.history import History, granted_priorities
from parallel_robot.bags.run import matching
from parallel_robot.bags.run.matching import Answers
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.plant import PlantParameters

Stamps = NDArray[np.int64]
EARLY = 1 << 17  # lags of steps before the first command that are told apart


class _Acting(NamedTuple):
    """The last state of a window, and the command that acted up to it."""

    stamp: int
    effort: NDArray[np.float64]
    command: tuple[int, int] | None = None  # state that it answers, time from which on it acts


class RunningTiming:
    """Timing of a run, see :func:`timing.evaluate`."""

    def __init__(self, history: History) -> None:
        """Prepare; `history`: what the bag says besides the motion."""
        self._history = history
        self._told = int(history.facts.get('start_stamp', 0))
        self._says = self._measured = self._begun = False
        self._first = self._told
        self._period = 0
        self._states, self._answered = 0, 0
        self._later = 0, 0  # the same after the last state that is answered
        self._before: _Acting | None = None
        self._lags: Counter[int] = Counter()
        self._early: Counter[int] = Counter()  # of steps before the first command
        self._idle = self._uncommanded = 0
        self._open = 0  # steps of which the next window says more
        self._delays, self._near, self._wall = Quantiles(), 0, False

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        if not len(log.stamps):
            return
        if not self._period:
            self._begin(log)
        answers, age = log.answers, reported_age(log.config)
        states = np.zeros(0, np.int64) if answers is None else answers.states
        states = states[states > 0]
        if states.size and not self._says:
            self._says = True
            self._first = self._told or int(states.min())
            if not self._told:
                self._later = 0, 0
        last = int(states.max()) if states.size and not self._told else int(log.stamps[-1])
        due = log.stamps + age >= self._first
        answered = due & ~np.isnan(log.answer[:, 0])
        late = log.stamps > last if states.size or self._told else np.ones(len(due), bool)
        if (due & ~late).any():
            self._states += self._later[0] + int((due & ~late).sum())
            self._answered += self._later[1] + int((answered & ~late).sum())
            self._later = 0, 0
        self._later = (
            self._later[0] + int((due & late).sum()),
            self._later[1] + int((answered & late).sum()),
        )
        self._measured &= log.has_efforts
        if self._measured and (self._told or self._says):
            self._follow(log, answers if states.size else None)
        if self._wall:
            delay = (log.heard - log.stamps - age) / NANOSECONDS
            self._near += int((np.abs(delay) * NANOSECONDS < SAME_CLOCK).sum())
            self._delays.add(delay)

    def finish(self) -> Timing:
        """The timing of the run."""
        lag = np.zeros(0, np.int64)
        if self._says and self._measured and self._lags:
            lag = counted(self._lags, range(1, 101))
        delay = np.zeros(0)
        if self._wall and 2 * self._near > self._delays.count:
            delay = self._delays.at(range(101))
        return Timing(
            self._states if self._says or self._told else self._later[0],
            self._answered if self._says else None,
            self._period / NANOSECONDS,
            lag,
            self._uncommanded + self._idle if self._says and self._measured else 0,
            delay,
            granted_priorities(self._history),
        )

    def _begin(self, log: RunLog) -> None:
        facts = self._history.facts
        self._period = loop_of(log.config).period_ns
        if not facts and len(log.stamps) > 1:
            self._period = int(np.median(np.diff(log.stamps)))
        self._measured = log.has_efforts
        stepped = log.config['time_mode'] == 'lockstep'
        self._wall = facts.get('source', NODES) == NODES and not stepped

    def _follow(self, log: RunLog, answers: Answers | None) -> None:
        """Find the lag of each step that ends in a window."""
        stamps, effort = log.stamps, log.effort
        if self._before is not None:
            stamps = np.concatenate(([self._before.stamp], stamps))
            effort = np.vstack((self._before.effort, effort))
        limit = np.array(group(log.config, PlantParameters, 'plant').torque_limit)
        since = np.zeros(len(stamps) - 1, np.int64)
        command = None if self._before is None else self._before.command
        silent, last = log.command, log.command[:0]
        if answers is not None:
            newest = np.searchsorted(np.maximum.accumulate(answers.states), stamps, 'right') - 1
            torque = np.clip(answers.torque, -limit, limit)
            at = self._place(answers)
            acting = acting_commands(effort, torque, newest, at)[1:]
            since = np.where(acting < 0, 0, answers.states[acting])
            acted = np.flatnonzero(acting >= 0)
            if acted.size:
                found = acting[acted[-1]]
                command = int(answers.states[found]), int(answers.acts[found])
            silent, last = _silent(log.command, answers.torque, self._before is None)
        self._before = _Acting(int(log.stamps[-1]), log.effort[-1:], command)
        due = stamps[:-1] >= self._first
        told = matching.among(effort[1:], np.clip(silent, -limit, limit))
        idle = due & (since == 0) & ~told
        of_last = idle & matching.among(effort[1:], np.clip(last, -limit, limit))
        idle &= ~of_last
        age = reported_age(log.config)
        steps = stamps[1:] - age
        if not self._begun:
            known = np.flatnonzero(since)
            begun = int(known[0]) if known.size else len(since)
            early = steps[:begun][due[:begun]] - (self._first - self._period)
            self._early.update(self._samples(early))
            if len(self._early) > EARLY:
                self._early = _coarser(self._early)
            self._idle += int(idle[:begun].sum())
            if not known.size:
                return
            self._begun = True
            self._lags, self._idle = self._early, 0
            since, steps, due = since[begun:], steps[begun:], due[begun:]
            idle, of_last = idle[begun:], of_last[begun:]
        answering = due & (since > 0)
        self._lags.update(self._samples((steps - since)[answering]))
        self._uncommanded += self._open + int(idle.sum())
        self._open = int(of_last.sum())

    def _samples(self, took: Stamps) -> dict[int, int]:
        """How many steps took so many samples; `took` [ns]."""
        lags, counts = np.unique(np.rint(took / self._period).astype(int), return_counts=True)
        return dict(zip(lags.tolist(), counts.tolist(), strict=True))

    def _place(self, answers: Answers) -> int:
        """Where the command is that acted up to the last window; -1: not here."""
        if self._before is None or self._before.command is None:
            return -1
        state, acts = self._before.command
        found = np.flatnonzero((answers.states == state) & (answers.acts == acts))
        return int(found[-1]) if found.size else -1


def _coarser(lags: Counter[int]) -> Counter[int]:
    """Fewer lags than EARLY, each changed by less than 2 / EARLY of the largest."""
    unit = -(-2 * max(lags) // EARLY)
    found: Counter[int] = Counter()
    for lag, count in lags.items():
        found[lag // unit * unit] += count
    return found


def _silent(
    commands: NDArray[np.float64], answers: NDArray[np.float64], first: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Commands of which the bag does not say which state they answer, without and with the last.

    Records of the last commands of a window may be in the next one; those of its first ones in
    the one before, unless it is the `first`.
    """
    told = np.flatnonzero(matching.among(commands, answers))
    begin, end = (told[0], told[-1] + 1) if told.size else (0, 0)
    inside = commands[0 if first else begin : end]
    return inside[~matching.among(inside, answers)], commands[end:]
