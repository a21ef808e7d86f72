"""All figures of one bag, of any length: a short one as a whole, a long one in windows."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions, run_results, timing
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.recorded_motions import PlantWindows
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.thinned import (
    WINDOW,
    Series,
    Track,
    long_path,
    thinned,
    thinned_series,
)
from parallel_robot.analysis.timing import Timing
from parallel_robot.analysis.windows import MotionWindows
from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.columns import Columns, MotionColumns
from parallel_robot.bags.files.bag_files import files
from parallel_robot.bags.history import History
from parallel_robot.bags.run import recorded_robot, recording, run_log, run_windows
from parallel_robot.bags.run.recorded_robot import NONE, RobotCode
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog, with_acting_commands
from parallel_robot.bags.run.run_windows import LogColumns, Stretch
from parallel_robot_model.common.errors import (
    BagError,
    KinematicsError,
    WholeNeededError,
)
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR, Topic
from parallel_robot_sim.motions import Motion, Motions
from parallel_robot_sim.simulation import saturated, saturation_of

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

    log: RunLog  # the run
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

    Those of a bag that is read in windows are the same up to rounding. One with hazards, whose
    plant has to move once more, is read as a whole as long as it fits in the memory.

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
    options: dict[str, Any] = {
        'code': code,
        'topics': topics,
        'view': view,
        'motion_only': motion_only,
    }
    if count:
        with contextlib.suppress(WholeNeededError):
            return _of_long(bag, count, part, warn, options)
    try:
        found = recorded_robot.read(bag, **options)
    except BagError:
        if count:
            with contextlib.suppress(WholeNeededError):
                return _of_long(bag, count, part, warn, options, move_again=False)
        raise
    for warning in found.log.warnings:
        warn(warning)
    if motion_only and not np.isfinite(found.log.reference_position).any():
        return MotionAlone(run_log.between(bag, found.log, *part))
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


def _of_long(
    bag: Path,
    count: int,
    part: tuple[float | None, float | None],
    warn: Callable[[str], None],
    options: Mapping[str, Any],
    move_again: bool = True,
) -> EvaluatedBag | MotionAlone:
    """The figures of a bag that is read in windows, into columns.

    Args:
        bag: The bag.
        count: About how many states it has.
        part: See :func:`evaluate`.
        warn: See :func:`evaluate`.
        options: Those of :func:`recorded_robot.chunks`.
        move_again: Whether its plant may move once more.
    """
    states, columns = LogColumns(bag), MotionColumns()
    couplings = Columns('the cross-coupling errors')
    following: MotionWindows | None = None
    limited = followed = last = 0
    remark, known_plant = '', True
    for found in recorded_robot.chunks(bag, WINDOW, **options):
        log, past, extra = found
        if following is None:
            again = move_again and recorded_motions.moves_again(log.config, past)
            plant = PlantWindows(bag, log.config, past) if again else None
            following, known_plant = MotionWindows(count, plant), recorded_motions.of_plant(past)
        states.add(log)
        errors = run_results.cross_coupling_of(log, extra.get(CROSS_COUPLING_ERROR))
        if errors is not None:
            couplings.add(errors._asdict())
        try:
            recorded = following.of(found)
        except KinematicsError as error:
            raise BagError(f'{bag}: {error}') from None
        if recorded is not None:
            columns.add(recorded.motions)
            known_plant &= not recorded_robot.unknown(recorded.log.config)
            if known_plant:
                limited += int(saturated(recorded.log.config, recorded.log.effort).sum())
            followed += len(recorded.log.time)
            last, remark = int(recorded.log.stamps[-1]), recorded.remark
    assert following is not None
    log = states.log()
    if following.cut or followed:
        following.check()
    elif not options['motion_only']:
        raise WholeNeededError(f'{bag} has no reference')
    else:
        return MotionAlone(run_log.between(bag, log, *part))
    for warning in filter(None, [*log.warnings, following.cut]):
        warn(warning)
    motions = columns.motions()
    best, told = motions.best, saturation_of(log.config, limited, followed)
    parts = run_windows.stretches(past, log.law, log.start_stamp, last)
    coupling = couplings.arrays()
    return EvaluatedBag(
        log,
        past,
        timing.evaluate(with_acting_commands(run_log.between(bag, log, *part)), past),
        metrics.figures(motions, *part),
        thinned(best),
        long_path(best),
        lambda times: best.rows(_rows(best, times)),
        followed,
        thinned_series(Series(**coupling)) if coupling else None,
        following.cut,
        parts,
        [*of_stretches(motions, parts)],
        last,
        [*filter(None, [remark]), *told],
        bool(told),
    )


def _rows(motion: Motion, times: np.ndarray) -> np.ndarray:
    """Rows of the first samples that are not before some times, or of the last one."""
    return np.clip(np.searchsorted(motion.time, times), 0, len(motion.time) - 1)
