"""All figures of one bag, of any length: a short one as a whole, a long one in windows."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions, run_results, timing
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.recorded_motions import PlantWindows
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.thinned import WINDOW, Series, Track, long_path, thinned
from parallel_robot.analysis.timing import Timing
from parallel_robot.analysis.windows import Course, MotionWindows
from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.files.bag_files import files
from parallel_robot.bags.history import History
from parallel_robot.bags.run import recorded_robot, recording, run_log, run_windows
from parallel_robot.bags.run.recorded_robot import NONE, RobotCode
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog, with_acting_commands
from parallel_robot.bags.run.run_windows import Stretch
from parallel_robot_model.common.errors import (
    BagError,
    KinematicsError,
    WholeNeededError,
)
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR, RECORDED, Topic
from parallel_robot_sim.motions import Motion, Motions
from parallel_robot_sim.simulation import saturation_of

SMALL = 16_000_000  # bytes of a bag that is read as a whole without a look at its index
LONG = 120.0  # s; a bag that is longer is read in windows
SHORTEST = 10  # states of a stretch of which there are figures


class PartFigures(NamedTuple):
    """Figures of a stretch of a run, and the time of its last sample [s]."""

    stretch: Stretch
    metrics: Metrics
    last: float


class EvaluatedBag(NamedTuple):
    """What is known of a bag."""

    log: RunLog  # the run: names, configuration and counts; of a long one, states of a part alone
    past: History  # what happened beside the motion
    timing: Timing  # how it kept its time
    metrics: Metrics
    # its true motion where that is known, else the one that was seen; of a long one, the
    # samples that can be seen in a picture
    motion: Motion
    path: Track  # its path; of a long one, parts of it with gaps
    # its samples at times, or the first ones after them, all in rising order
    at: Callable[[np.ndarray], Motion]
    samples: int  # how many samples it has
    # cross-coupling errors [rad], if asked for and in the bag; of a long one, those that can
    # be seen in a picture
    cross_coupling: Series | None
    cut: str  # why only a part of it was evaluated; empty when all of it was
    parts: list[Stretch]  # its stretches between changes
    figures: list[PartFigures]  # figures of each of several stretches
    last: int  # stamp of its last state [ns]
    remarks: list[str]  # what to know of the figures, one line each
    saturated: bool  # whether a plant that is known gave all it can


def evaluate(
    bag: Path,
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
    part: tuple[float | None, float | None] = (None, None),
    warn: Callable[[str], None] = lambda _: None,
    topics: Collection[Topic] = (),
    motion_only: bool = True,
) -> EvaluatedBag | MotionAlone:
    """Find the figures of a bag.

    Those of a bag that is read in windows are the same up to rounding, but that percentiles of
    many delays are within 0.05 %. One with hazards, whose plant has to move once more, is read
    as a whole as long as it fits in the memory.

    Args:
        bag: Directory of the bag, or its MCAP file.
        code: What may run to know its robot.
        view: What it does not say itself.
        part: First and last time of the part that all figures are of [s]; None: see
            :func:`metrics.figures`.
        warn: Is told each defect of the bag as soon as it is known.
        topics: What else is wanted: none, or CROSS_COUPLING_ERROR.
        motion_only: Whether references and commands may be missing.

    Returns:
        The figures; of a bag without references what is known of its motion alone.

    Raises:
        BagError: not a bag of a run, it takes too much, or nothing is in the part.
        InputError: the robot of the bag cannot be built, or nothing is in the part.
    """
    count = long(bag, view)
    if count:
        windows = _LongBag(bag, code, view, part, count, topics, motion_only)
        with contextlib.suppress(WholeNeededError):
            return windows.evaluated(warn)
    try:
        found = recorded_robot.read(
            bag, code=code, topics=topics, view=view, motion_only=motion_only
        )
    except BagError:
        if count and windows.moves_again:
            return windows.evaluated(warn, moved=False)
        raise
    for warning in found.log.warnings:
        warn(warning)
    if motion_only and not np.isfinite(found.log.reference_position).any():
        alone = MotionAlone()
        alone.add(run_log.between(bag, found.log, *part))
        return alone
    return of_whole(bag, found, part, warn)


def long(bag: Path, view: BagView) -> int:
    """About how many states a bag has that is read in windows; 0: it is read as a whole."""
    if sum(path.stat().st_size for path in files(bag) if path.is_file()) < SMALL:
        return 0
    seconds, count = recording.size(bag, view)
    return count if seconds > LONG else 0


def of_whole(
    bag: Path,
    found: Recording,
    part: tuple[float | None, float | None] = (None, None),
    warn: Callable[[str], None] = lambda _: None,
) -> EvaluatedBag:
    """The figures of a bag that was read as a whole; arguments as of :func:`evaluate`.

    Raises:
        BagError: the motion has no pose, or nothing is in the part.
        InputError: the robot of the bag cannot be built, or nothing is in the part.
    """
    log, past, extra = found
    part_of = run_log.between(bag, log, *part)
    timed = timing.evaluate(with_acting_commands(part_of), past)
    try:
        motions = recorded_motions.of_bag(log, past)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    log = motions.log
    if motions.cut:
        warn(motions.cut)
    last, best = int(log.stamps[-1]), motions.motions.best
    parts = run_windows.stretches(past, log.law, log.start_stamp, last)
    return EvaluatedBag(
        log,
        past,
        timed,
        metrics.figures(motions.motions, *part),
        best,
        Track(best.time, best.poses),
        lambda times: best.rows(_rows(best, times)),
        len(best.time),
        run_results.cross_coupling_of(log, extra.get(CROSS_COUPLING_ERROR)),
        motions.cut,
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


class _LongBag:
    """A bag that is read in windows, its motion into columns."""

    def __init__(
        self,
        bag: Path,
        code: RobotCode,
        view: BagView,
        part: tuple[float | None, float | None],
        count: int,
        topics: Collection[Topic],
        motion_only: bool,
    ) -> None:
        self._bag, self._code, self._view, self._part = bag, code, view, part
        self._count, self._topics, self._motion_only = count, topics, motion_only
        windows = self._windows()
        first = next(windows)
        self._opened: Iterator[Recording] | None = itertools.chain((first,), windows)
        self._past, self._config = first.history, first.log.config
        self._law, self._start = first.log.law, first.log.start_stamp
        self.moves_again = recorded_motions.moves_again(self._config, self._past)

    def evaluated(
        self, warn: Callable[[str], None], moved: bool = True
    ) -> EvaluatedBag | MotionAlone:
        """All its figures; `moved`: whether its plant may move once more."""
        self._moved = moved and self.moves_again
        course = Course(self._part, self._past)
        self._read(course, warn)
        if not course.referenced:
            if not self._motion_only:
                raise WholeNeededError(f'{self._bag} has no reference')
            course.check(self._bag)
            return course.alone
        if self._part != (None, None):
            course.check(self._bag)
        motions = course.motions()
        best = motions.best
        found = metrics.figures(motions, *self._part)
        log, config = course.log, self._config
        known = run_windows.stretches(self._past, self._law, self._start, course.last)
        told = saturation_of(config, course.saturated, course.samples)
        counts = course.messages
        ordered = {each.name: counts[each.name] for each in RECORDED if each.name in counts}
        return EvaluatedBag(
            log._replace(messages=ordered),
            self._past,
            course.timing.finish(),
            found,
            thinned(best),
            long_path(best),
            lambda times: best.rows(_rows(best, times)),
            course.samples,
            course.coupling(),
            course.cut,
            known,
            [*of_stretches(motions, known)],
            course.last,
            [*filter(None, [course.remark]), *told],
            bool(told),
        )

    def _windows(self) -> Iterator[Recording]:
        return recorded_robot.chunks(
            self._bag,
            WINDOW,
            code=self._code,
            topics=self._topics,
            view=self._view,
            motion_only=self._motion_only,
        )

    def _read(self, course: Course, warn: Callable[[str], None]) -> None:
        """Go through the windows."""
        plant = PlantWindows(self._bag, self._config, self._past) if self._moved else None
        motions = MotionWindows(self._count, plant)
        windows, self._opened = self._opened or self._windows(), None
        for found in windows:
            course.add(self._bag, found)
            try:
                part = motions.of(found)
            except KinematicsError as error:
                raise BagError(f'{self._bag}: {error}') from None
            if part is not None:
                course.follow(part)
        motions.check()
        course.cut = motions.cut
        for warning in filter(None, [*course.warnings, motions.cut]):
            warn(warning)


def _rows(motion: Motion, times: np.ndarray) -> np.ndarray:
    """Rows of the first samples that are not before some times, or of the last one."""
    return np.clip(np.searchsorted(motion.time, times), 0, len(motion.time) - 1)
