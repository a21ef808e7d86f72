"""A run of a bag, window by window, as often as it is looked through."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from parallel_robot.bags.history import History
from parallel_robot.bags.reading.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.run import recording, run_log
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.errors import WholeNeededError

STATES = (
    100_000  # of which the period is the median, at least: that of a recording does not change
)
Result = TypeVar('Result')


class RunWindows:
    """A run in windows; references and commands may be missing.

    Attributes:
        log: The run without its states.
        history: What happened beside the motion.
        period: Time between two states [s]; 0 where there are no two.
    """

    def __init__(self, bag: Path, view: BagView = AS_RECORDED) -> None:
        """Open a bag.

        Args:
            bag: Directory of the bag, or its MCAP file.
            view: What it does not say itself, and which part is wanted.

        Raises:
            BagError: not a bag, or one that is not of a run.
        """
        self._bag, self._view = bag, view
        self._whole: Recording | None = None
        self.log, self.history, self.period = self._evaluated(_begun)

    def evaluated(self, evaluate: Callable[[Iterator[RunLog]], Result]) -> Result:
        """What is made of all windows, or of the run at once where windows are not enough.

        Raises:
            BagError: a window takes too much, or there is no state in the part that is wanted.
        """
        return self._evaluated(lambda windows: evaluate(self._alike(windows)))

    def _evaluated(self, evaluate: Callable[[Iterator[Recording]], Result]) -> Result:
        if self._whole is None:
            try:
                return evaluate(self._recordings())
            except WholeNeededError:
                self._whole = recording.read(self._bag, motion_only=True, view=self._view)
        return evaluate(self._recordings())

    def _recordings(self) -> Iterator[Recording]:
        if self._whole is not None:
            return iter([self._whole])
        return recording.chunks(self._bag, SECONDS, motion_only=True, view=self._view)

    def _alike(self, windows: Iterator[Recording]) -> Iterator[RunLog]:
        for window in windows:
            if self._whole is None and window.log.kind != self.log.kind:
                raise WholeNeededError('the parts of the bag do not hold the same')
            yield window.log


def _begun(windows: Iterator[Recording]) -> tuple[RunLog, History, float]:
    """The run without its states, what happened beside it, and its period."""
    first: Recording | None = None
    steps, count = [], 0
    for window in windows:
        first = first or window._replace(log=run_log.head(window.log, 0))
        between = np.diff(window.log.time)
        steps.append(between[between > 0.0])
        count += len(between)
        if count >= STATES:
            break
    if first is None:
        raise WholeNeededError('no window has a state')
    known = np.concatenate(steps)
    return first.log, first.history, float(np.median(known)) if len(known) else 0.0
