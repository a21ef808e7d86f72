"""A long bag window by window: its motions, its timing, and what is known of it by then."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis import recorded_motions, run_results
from parallel_robot.analysis.recorded_motions import MOST_STEPS, PLANNED, PlantWindows, Recorded
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.thinned import Series, thinned_series
from parallel_robot.analysis.timing import SAME_CLOCK, Quantiles, Timing, acting_commands, counted
from parallel_robot.bags.columns import Columns, MotionColumns
from parallel_robot.bags.experiment import NODES
from parallel_robot.bags.history import History, granted_priorities
from parallel_robot.bags.run import matching, recorded_robot, run_log
from parallel_robot.bags.run.matching import Answers
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog, TopicCount
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot_model.common.errors import BagError, KinematicsError, ParallelRobotError
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.ideal_torque import IdealTorque
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.motions import Motion, Motions
from parallel_robot_sim.plant import MUJOCO, PlantParameters
from parallel_robot_sim.simulation import saturated
from trajectory_gen.configuration import trajectory_of

# How a run of any length kept its time, window by window.

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
        self._newest = self._gap = 0  # stamp of the last state, longest step to one [ns]
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
            self._newest = int(log.stamps[0])
        self._gap = max(self._gap, int(np.diff(log.stamps, prepend=self._newest).max()))
        self._newest = int(log.stamps[-1])
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
            self._gap,
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


# What is known of a long bag up to a window, but for its metrics.


class Course:
    """What is known of a run up to a window, but for its metrics."""

    def __init__(self, part: tuple[float | None, float | None], past: History) -> None:
        self._part = part
        self._known_plant = recorded_motions.of_plant(past)
        self.timing, self.alone = RunningTiming(past), MotionAlone()
        self.messages: dict[str, TopicCount] = {}
        self._warnings = AlikeLines()
        self._motions, self._coupling = MotionColumns(), Columns('cross-coupling errors')
        self.referenced = False
        self.saturated = self.samples = self.last = self._inside = 0
        self.times = (math.inf, -math.inf)
        self.followed = (math.nan, math.nan)
        self.remark = self.cut = ''

    def add(self, bag: Path, found: Recording) -> None:
        """Take what a window of a bag says, with or without a motion."""
        self.log = log = found.log
        for name, count in log.messages.items():
            before = self.messages.get(name, TopicCount(0, 0))
            self.messages[name] = TopicCount(
                before.count + count.count, before.missing + count.missing
            )
        self._warnings.take(bag, log)
        self.referenced |= bool(np.isfinite(log.reference_position).any())
        low, high = self.times
        self.times = min(low, float(log.time.min())), max(high, float(log.time.max()))
        start, stop = self._part
        chosen = np.flatnonzero(
            (log.time >= (-math.inf if start is None else start))
            & (log.time <= (math.inf if stop is None else stop))
        )
        self._inside += len(chosen)
        errors = run_results.cross_coupling_of(log, found.extra.get(CROSS_COUPLING_ERROR))
        if errors is not None:
            self._coupling.add(errors._asdict())
        if len(chosen):
            inside = log if len(chosen) == len(log.time) else run_log.rows(log, chosen)
            self.alone.add(inside)
            self.timing.add(run_log.with_acting_commands(inside))

    def follow(self, part: Recorded) -> None:
        """Take the motion of a window."""
        best = part.motions.best
        self._known_plant &= not recorded_robot.unknown(part.log.config)
        begin = self.followed[0] if self.samples else float(best.time[0])
        self.followed = begin, float(best.time[-1])
        self._motions.add(part.motions)
        if self._known_plant:
            self.saturated += int(saturated(part.log.config, part.log.effort).sum())
        self.samples += len(part.log.time)
        self.last, self.remark = int(part.log.stamps[-1]), part.remark

    def motions(self) -> Motions:
        """All of the motions."""
        return self._motions.motions()

    def coupling(self) -> Series | None:
        """What can be seen of the cross-coupling errors; None when they are not in the bag."""
        found = self._coupling.arrays()
        return thinned_series(Series(**found)) if found else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the bag: what is said of several windows once, as of the first."""
        return self._warnings.lines

    def check(self, bag: Path) -> None:
        """Refuse a part of a run without states.

        Raises:
            BagError: it is one.
        """
        if not self._inside:
            raise BagError(run_log.no_state(bag, *self.times))


# The motions of a bag of any length, window by window.


class MotionWindows:
    """The motions of windows that follow each other, as those of the whole bag.

    Of a bag whose states do not tell the true joints, a plant has to move once more.
    """

    def __init__(self, count: int, plant: PlantWindows | None = None) -> None:
        """Prepare.

        Args:
            count: How many states the bag has, about.
            plant: Tells the true motion, if the states do not.
        """
        self._count = count
        self._ideal: _Ideal | None = None
        self._motions, self._plant = recorded_motions.InParts(plant), plant
        self._end = math.nan  # s, time of the last state that was followed
        # why the motion was followed up to a window alone; empty when it was not cut off
        self.cut = ''

    def of(self, found: Recording) -> Recorded | None:
        """The motions of the next window; None where it has none, as after a cut.

        Raises:
            InputError: the robot of the bag cannot be built.
            KinematicsError: the first sample of the bag has no pose.
            WholeNeededError: the plant cannot move once more in windows.
        """
        log = found.log
        if self.cut or not log.referenced.any():
            return None
        try:
            part = self._motions.of(log, found.history, whole=False)
        except KinematicsError as error:
            if math.isnan(self._end):
                raise
            self.cut = f'evaluated up to t = {self._end:.3f} s: {error}'
            return None
        true = part.motions.true
        if true is not None:
            self._ideal = self._ideal or _Ideal(log.config, self._count)
            part = part._replace(motions=part.motions._replace(ideal=self._ideal.of(true)))
        self._end, self.cut = float(part.log.time[-1]), part.cut
        return part

    def check(self) -> None:
        """Refuse a plant that was another one than that of the bag, at its end.

        Raises:
            WholeNeededError: it was.
        """
        if self._plant is not None:
            self._plant.check()


class _Ideal:
    """The ideal torque at the samples of a true motion, as long as it is the planned one."""

    def __init__(self, values: Mapping[str, Any], count: int) -> None:
        """Prepare; `count`: how many samples it has, about."""
        self._first = self._samples = 0
        self._known = False
        try:
            configuration, self._trajectory = configure_plant(values), trajectory_of(values)
            self._period = configuration.loop.period
            if (configuration.loop.last_index or 0) < count - 1:  # it had no end
                duration = (count - 1) * self._period
                configuration = configuration.with_parts(
                    loop=configuration.loop._replace(duration=duration)
                )
            self._last = configuration.loop.last_index or 0
            self._torque = IdealTorque(self._trajectory, configuration)
            self._known = configuration.plant.engine != MUJOCO
        except ParallelRobotError:
            return

    def of(self, true: Motion) -> Array | None:
        """Torques at the next samples [N m], shape (N, n); None where they are not known."""
        if not self._known:
            return None
        rows = np.rint(true.time / self._period).astype(np.int64)
        first, last = self._first, int(rows[-1])
        self._samples += len(rows)
        self._known = first <= rows[0] <= last <= min(MOST_STEPS * self._samples, self._last)
        if not self._known:
            return None
        try:
            planned = self._trajectory.sample(self._period * rows).position
            self._known = bool(np.abs(planned - true.reference_position).max() <= PLANNED)
            self._first = last + 1
            return self._torque.between(first, last + 1)[rows - first] if self._known else None
        except ParallelRobotError:
            self._known = False
            return None
