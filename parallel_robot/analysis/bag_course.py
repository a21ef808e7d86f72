"""What is known of a long bag up to a window, but for its metrics."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from parallel_robot.analysis import cross_coupling, recorded_motions
from parallel_robot.analysis.motion_alone import MotionAlone
from parallel_robot.analysis.recorded_motions import Recorded
from parallel_robot.analysis.running_metrics import joined
from parallel_robot.analysis.running_timing import RunningTiming
from parallel_robot.analysis.thinned import (
    Growing,
    GrowingTrack,
    Series,
    Track,
    joined_series,
    thinned,
    thinned_series,
)
from parallel_robot.bags.history import History
from parallel_robot.bags.run import recorded_robot, run_log
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import TopicCount
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR
from parallel_robot_sim.motions import Motion
from parallel_robot_sim.simulation import saturated


class Course:
    """What is known of a run up to a window, but for its metrics."""

    def __init__(self, part: tuple[float | None, float | None], past: History, count: int) -> None:
        self._part, self._count = part, count
        self._known_plant = recorded_motions.of_plant(past)
        self.timing, self.alone = RunningTiming(past), MotionAlone()
        self.messages: dict[str, TopicCount] = {}
        self._warnings = AlikeLines()
        self._motion, self._path = Growing(thinned, joined), GrowingTrack()
        self._coupling = Growing(thinned_series, joined_series)
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
        errors = cross_coupling.of(log, found.extra.get(CROSS_COUPLING_ERROR))
        if errors is not None:
            self._coupling.add(errors, len(log.time) / max(self._count, 1))
        if len(chosen):
            inside = log if len(chosen) == len(log.time) else run_log.rows(log, chosen)
            self.alone.add(inside)
            self.timing.add(inside)

    def follow(self, part: Recorded) -> None:
        """Take the motion of a window."""
        best = part.motions.best
        self._known_plant &= not recorded_robot.unknown(part.log.config)
        begin = self.followed[0] if self.samples else float(best.time[0])
        self.followed = begin, float(best.time[-1])
        share = len(best.time) / max(self._count, 1)
        self._path.add(best, share)
        self._motion.add(best, share)
        if self._known_plant:
            self.saturated += int(saturated(part.log.config, part.log.effort).sum())
        self.samples += len(part.log.time)
        self.last, self.remark = int(part.log.stamps[-1]), part.remark

    def motion(self) -> Motion:
        """What can be seen of the motion."""
        found = self._motion.whole()
        assert found is not None
        return found

    def path(self) -> Track:
        """What can be seen of its path: that of the first window, and parts of all others."""
        return self._path.whole()

    def coupling(self) -> Series | None:
        """What can be seen of the cross-coupling errors; None when they are not in the bag."""
        return self._coupling.whole()

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
