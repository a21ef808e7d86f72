"""All figures of one bag, of any length: a short one as a whole, a long one in windows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions, timing
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.motion_alone import MotionAlone
from parallel_robot.analysis.motion_windows import MotionWindows
from parallel_robot.analysis.recorded_motions import Recorded
from parallel_robot.analysis.report.thinned import path_of, thinned
from parallel_robot.analysis.running_metrics import Plan, RunningFigures, all_of_it, joined
from parallel_robot.analysis.running_timing import RunningTiming
from parallel_robot.analysis.timing import Timing
from parallel_robot.bags import recorded_robot, recording, run_log, stretches
from parallel_robot.bags.alike_lines import AlikeLines
from parallel_robot.bags.bag_files import files
from parallel_robot.bags.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.counts import TopicCount
from parallel_robot.bags.history import History
from parallel_robot.bags.recorded_robot import NONE, RobotCode
from parallel_robot.bags.recording import Recording
from parallel_robot.bags.run_log import RunLog
from parallel_robot.bags.span import LAST
from parallel_robot.bags.stretches import Stretch
from parallel_robot_model.common.errors import (
    BagError,
    InputError,
    KinematicsError,
    WholeNeededError,
)
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.messages.topics import RECORDED
from parallel_robot_sim.motions import Motion, Motions, Poses
from parallel_robot_sim.saturation import saturated, saturation_of

SMALL = 16_000_000  # bytes of a bag that is read as a whole without a look at its index
LONG = 120.0  # s; a bag that is longer is read in windows
WINDOW = 20.0  # s, that are read at once
SHORTEST = 10  # states of a stretch of which there are figures
INTERVALS = 1500  # of a picture of a long run, of each of which the extremes are kept
PATH = 600.0  # s, of which the path of a long run is drawn


class PartFigures(NamedTuple):
    """Figures of a stretch of a run, and the time of its last sample [s]."""

    stretch: Stretch
    metrics: Metrics
    last: float


class EvaluatedBag(NamedTuple):
    """What is known of a bag.

    Attributes:
        log: The run: names, configuration and counts; of a long one, states of a part alone.
        past: What happened beside the motion.
        timing: How it kept its time.
        metrics: Its metrics.
        motion: Its true motion where that is known, else the one that was seen; of a long one,
            the samples that can be seen in a picture.
        path: The poses of its path; of a long one, of parts of it with gaps.
        parts: Its stretches between changes.
        figures: Figures of each of several stretches.
        last: Stamp of its last state [ns].
        remarks: What to know of the figures, one line each.
        saturated: Whether a plant that is known gave all it can.
    """

    log: RunLog
    past: History
    timing: Timing
    metrics: Metrics
    motion: Motion
    path: Poses
    parts: list[Stretch]
    figures: list[PartFigures]
    last: int
    remarks: list[str]
    saturated: bool


def evaluate(
    bag: Path,
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
    part: tuple[float | None, float | None] = (None, None),
    warn: Callable[[str], None] = lambda _: None,
) -> EvaluatedBag | MotionAlone:
    """Find the figures of a bag.

    Those of a bag that is read in windows are the same up to rounding, but that percentiles of
    many delays are within 0.05 %. One whose plant has to move once more is read as a whole as
    long as it fits in the memory.

    Args:
        bag: Directory of the bag, or its MCAP file.
        code: What may run to know its robot.
        view: What it does not say itself.
        part: First and last time of the part that all figures are of [s]; None: see
            :func:`metrics.figures`.
        warn: Is told each defect of the bag as soon as it is known.

    Returns:
        The figures; of a bag without references what is known of its motion alone.

    Raises:
        BagError: not a bag of a run, it takes too much, or nothing is in the part.
        InputError: the robot of the bag cannot be built, or nothing is in the part.
    """
    small = sum(path.stat().st_size for path in files(bag) if path.is_file()) < SMALL
    seconds, count = (0.0, 0) if small else recording.size(bag, view)
    if seconds > LONG:
        long = _LongBag(bag, code, view, part, count)
        try:
            if not long.moves_again:
                return long.evaluated(warn)
        except WholeNeededError:
            pass
    try:
        found = recorded_robot.read(bag, code=code, view=view, motion_only=True)
    except BagError:
        if seconds > LONG and long.moves_again:
            return long.evaluated(warn)
        raise
    for warning in found.log.warnings:
        warn(warning)
    return _of_whole(bag, found, part, warn)


def _of_whole(
    bag: Path,
    found: Recording,
    part: tuple[float | None, float | None],
    warn: Callable[[str], None],
) -> EvaluatedBag | MotionAlone:
    log, past, _ = found
    part_of = run_log.between(bag, log, *part)
    if not np.isfinite(log.reference_position).any():
        alone = MotionAlone()
        alone.add(part_of)
        return alone
    timed = timing.evaluate(part_of, past)
    try:
        motions = recorded_motions.of_bag(log, past)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    log = motions.log
    if motions.cut:
        warn(motions.cut)
    parts = stretches.of_run(past, log)
    return EvaluatedBag(
        log,
        past,
        timed,
        metrics.figures(motions.motions, *part),
        motions.motions.best,
        motions.motions.best.poses,
        parts,
        [*of_stretches(motions.motions, parts)],
        int(log.stamps[-1]),
        motions.remarks,
        bool(motions.saturated),
    )


def of_stretches(motions: Motions, parts: Sequence[Stretch]) -> Iterator[PartFigures]:
    """Figures of each of several stretches of a run, over the second half of each."""
    ends = [*(one.begin for one in parts[1:]), math.inf]
    for one, end in zip(parts, ends, strict=True):
        part = motions.between(one.begin, end)
        if len(parts) > 1 and len(part.best.time) >= SHORTEST:
            yield PartFigures(one, metrics.figures(part), float(part.best.time[-1]))


class _Job:
    """A part of a run whose metrics are wanted, until the plan for it was right."""

    def __init__(self, begin: float, end: float, asked: bool, plan: Plan) -> None:
        """Prepare, see :class:`RunningFigures`."""
        self.begin, self.end, self._asked, self._plan = begin, end, asked, plan
        self._running: RunningFigures | None = None
        self.found: Metrics | None = None
        self.count, self.last, self.settled = 0, math.nan, False

    def add(self, motions: Motions) -> None:
        """Take the next part of the run."""
        time = motions.best.time
        if self.settled or time[-1] < self.begin or (self._running is None and self.found):
            return
        if self._running is None:
            self._running = RunningFigures(self.begin, self.end, self._asked, self._plan)
        self._running.add(motions)
        if time[-1] >= self.end:
            self._finish()

    def end_of_bag(self) -> None:
        """The run is over."""
        if self._running is not None:
            self._finish()
        self.settled |= self.found is None
        if not self.settled:
            self.found = None

    def _finish(self) -> None:
        assert self._running is not None
        self.found, plan = self._running.finish()
        self.count, self.last = self._running.count, self._running.last
        self.settled = plan == self._plan
        self._plan, self._running = plan, None


class _LongBag:
    """A bag that is read in windows: once if it is as expected, else again with what is known."""

    def __init__(
        self,
        bag: Path,
        code: RobotCode,
        view: BagView,
        part: tuple[float | None, float | None],
        count: int,
    ) -> None:
        self._bag, self._code, self._view, self._part = bag, code, view, part
        self._count = count
        windows = self._windows()
        first = next(windows)
        self._opened: Iterator[Recording] | None = itertools.chain((first,), windows)
        self._past, self._config = first.history, first.log.config
        self._law, self._start = first.log.law, first.log.start_stamp
        self.moves_again = recorded_motions.moves_again(self._config, self._past)

    def evaluated(self, warn: Callable[[str], None]) -> EvaluatedBag | MotionAlone:
        """All its figures."""
        course = _Course(self._part, self._past, self._count)
        whole, parts = self._jobs()
        self._read([whole, *parts], course, warn)
        if not course.referenced:
            course.check(self._bag)
            return course.alone
        while not all(job.settled for job in (whole, *parts)):
            self._read([whole, *parts])
        asked = self._part != (None, None)
        if asked:
            course.check(self._bag)
        if whole.found is None:
            raise InputError(metrics.nothing_between(whole.begin, whole.end, *course.followed))
        begin, end = course.followed
        window = whole.found.window._replace(run_s=end - begin)
        log, config = course.log, self._config
        known = stretches.stretches(self._past, self._law, self._start, course.last)
        figures = [
            PartFigures(one, job.found, job.last)
            for one, job in zip(known, parts, strict=False)
            if job.found is not None and job.count >= SHORTEST
        ]
        told = saturation_of(config, course.saturated, course.samples)
        return EvaluatedBag(
            log._replace(messages=_ordered(course.messages)),
            self._past,
            course.timing.finish(),
            whole.found._replace(window=window),
            course.motion(),
            course.path(),
            known,
            figures,
            course.last,
            [*filter(None, [course.remark]), *told],
            bool(told),
        )

    def _windows(self) -> Iterator[Recording]:
        return recorded_robot.chunks(
            self._bag, WINDOW, code=self._code, view=self._view, motion_only=True
        )

    def _read(
        self,
        jobs: Sequence[_Job],
        course: _Course | None = None,
        warn: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Go through the windows once."""
        motions = MotionWindows(self._count)
        windows, self._opened = self._opened or self._windows(), None
        for found in windows:
            if course is not None:
                course.add(self._bag, found)
            try:
                part = motions.of(found)
            except KinematicsError as error:
                raise BagError(f'{self._bag}: {error}') from None
            if part is None:
                continue
            for job in jobs:
                job.add(part.motions)
            if course is not None:
                course.follow(part)
        for job in jobs:
            job.end_of_bag()
        if course is not None:
            for warning in course.warnings:
                warn(warning)
            if motions.cut:
                warn(motions.cut)

    def _jobs(self) -> tuple[_Job, list[_Job]]:
        """The figures of all of it, and of its stretches."""
        period = loop_of(self._config).period
        parts = stretches.stretches(self._past, self._law, self._start, LAST)
        begins = [one.begin for one in parts]
        ends = [*begins[1:], math.inf]
        jobs = [
            _Job(begin, end, False, self._plan(begin, end, period))
            for begin, end in zip(begins, ends, strict=True)
            if len(parts) > 1
        ]
        start, stop = self._part
        if (start, stop) == (None, None):
            return _Job(-math.inf, math.inf, False, self._plan(-math.inf, math.inf, period)), jobs
        begin = -math.inf if start is None else start
        end = math.inf if stop is None else float(np.nextafter(stop, math.inf))
        return _Job(begin, end, True, Plan()), jobs

    def _plan(self, begin: float, end: float, period: float) -> Plan:
        """The plan for a part that moves all the time, of a run that lacks nothing."""
        first, stop = (
            math.ceil(min(max(time / period - 1e-6, 0.0), self._count)) for time in (begin, end)
        )
        halves = all_of_it(stop - first)
        both = recorded_motions.two_motions(self._config, self._past)
        return Plan(math.inf, *(halves if one else None for one in both))


class _Course:
    """What is known of a run up to a window, but for its metrics."""

    def __init__(self, part: tuple[float | None, float | None], past: History, count: int) -> None:
        self._part, self._count = part, count
        self._known_plant = recorded_motions.of_plant(past)
        self.timing, self.alone = RunningTiming(past), MotionAlone()
        self.messages: dict[str, TopicCount] = {}
        self._warnings = AlikeLines()
        self._motion: list[Motion] = []
        self._path: list[Poses] = []
        self.referenced = False
        self.saturated = self.samples = self.last = self._inside = 0
        self.times = (math.inf, -math.inf)
        self.followed = (math.nan, math.nan)
        self.remark = ''

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
        if len(chosen):
            inside = log if len(chosen) == len(log.time) else run_log.rows(log, chosen)
            self.alone.add(inside)
            self.timing.add(inside)

    def follow(self, part: Recorded) -> None:
        """Take the motion of a window."""
        best = part.motions.best
        self._known_plant &= not recorded_robot.unknown(part.log.config)
        begin = self.followed[0] if self._motion else float(best.time[0])
        self.followed = begin, float(best.time[-1])
        share = len(best.time) / max(self._count, 1)
        self._path.append(path_of(best, PATH * share if self._motion else math.inf))
        self._motion.append(thinned(best, max(1, round(INTERVALS * share))))
        if self._known_plant:
            self.saturated += int(saturated(part.log.config, part.log.effort).sum())
        self.samples += len(part.log.time)
        self.last, self.remark = int(part.log.stamps[-1]), part.remark

    def motion(self) -> Motion:
        """What can be seen of the motion."""
        return joined(self._motion)

    def path(self) -> Poses:
        """What can be seen of its path: that of the first window, and parts of all others."""
        actual, reference, planar = zip(*self._path, strict=True)
        return Poses(np.concatenate(actual), np.concatenate(reference), planar[0])

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


def _ordered(counts: Mapping[str, TopicCount]) -> dict[str, TopicCount]:
    """Counts in the order of the topics."""
    return {topic.name: counts[topic.name] for topic in RECORDED if topic.name in counts}
