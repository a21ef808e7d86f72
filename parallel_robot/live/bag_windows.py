"""A long bag as the page needs it: the states around a moment, read when they are shown."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from parallel_robot.analysis.replay import replayed
from parallel_robot.analysis.replay.bag_replay import with_last
from parallel_robot.bags.reading.bag_view import BagView
from parallel_robot.bags.run import recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_model.common.errors import BagError, WholeNeededError
from parallel_robot_model.common.units import Array

AHEAD = 30.0  # s after a moment that are read with it
BACK = (10.0, 1000.0, math.inf)  # s before the end, where the last state is looked for


class BagWindows:
    """Parts of a bag.

    Attributes:
        begun: What it holds, with its first states.
        first: Time of its first state [s].
        last: Time of its last state [s].
        last_stamp: Stamp of that [ns].
    """

    def __init__(self, bag: Path, view: BagView) -> None:
        """Open a bag.

        Args:
            bag: Directory of the bag, or its MCAP file.
            view: What it does not say itself, and which part is wanted.

        Raises:
            BagError: it is not a bag of a run, or cannot be read in windows.
        """
        self._bag, self._view = bag, view
        self._reader = recording.Seekable(bag, motion_only=True, view=view)
        self.begun = next(recording.chunks(bag, AHEAD, motion_only=True, view=view))
        self.first = float(self.begun.log.time[0])
        end = self._end()
        self.last, self.last_stamp = float(end.time[-1]), int(end.stamps[-1])

    def between(self, begin: float, end: float) -> RunLog | None:
        """States from one time to another [s], both included; None where there is none."""
        try:
            return self._reader.between(begin, end + 1e-9).log
        except BagError:
            return None

    def answered(self, configuration: ControlConfiguration) -> Torques:
        """The torques of another law, from the first state to the last.

        Raises:
            BagError: a state has no pose, or the bag cannot be read in windows.
        """
        parts = replayed.InParts(self.begun.history, configuration, obeyed=False)
        rest = recording.chunks(self._bag, AHEAD, motion_only=True, view=self._view)
        found = Torques(len(self.begun.log.joints))
        for log, last in with_last(next(rest).log, rest):
            done, result = parts.answered(log, last)
            found.add(done.time, result.torque)
        return found

    def _end(self) -> RunLog:
        """The last states."""
        seconds, _ = recording.size(self._bag, self._view)
        stop = math.inf if self._view.stop is None else self._view.stop
        end = min(self.first + seconds, stop)
        for back in BACK:
            found = self.between(
                max(end - back, self.first), min(self.first + 2.0 * seconds, stop)
            )
            if found is not None:
                return found
        raise WholeNeededError(f'{self._bag} has no states in its windows')


class Torques:
    """Torques of each state of a run, in files without a name."""

    def __init__(self, joints: int) -> None:
        """Begin without any; `joints`: how many each state has."""
        self._joints = joints
        self._times = tempfile.TemporaryFile()  # noqa: SIM115  closed with this
        self._rows = tempfile.TemporaryFile()  # noqa: SIM115

    def add(self, time: Array, torque: Array) -> None:
        """Take the next states: times [s], shape (N,), torques [N m], shape (N, n)."""
        for file, values in ((self._times, time), (self._rows, torque)):
            file.write(values.tobytes())
            file.flush()

    def at(self, time: Array) -> Array:
        """Torques of states by their times [s], shape (N,); NaN where there is none."""
        known = np.memmap(self._times, np.float64, 'r')
        rows = np.minimum(np.searchsorted(known, time), len(known) - 1)
        torque = np.memmap(self._rows, np.float64, 'r').reshape(-1, self._joints)
        found = np.array(torque[rows[0] : rows[-1] + 1][rows - rows[0]])
        found[known[rows] != time] = np.nan
        return found
