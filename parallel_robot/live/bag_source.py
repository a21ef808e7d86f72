"""A bag, as the page sees it; no nodes are needed. All browsers see the same moment."""

from __future__ import annotations

import asyncio
import math
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis import evaluated_bag, recorded_motions
from parallel_robot.analysis.replay import bag_replay, replayed
from parallel_robot.analysis.replay.bag_replay import with_last
from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.experiment import UNKNOWN_LAW
from parallel_robot.bags.history import History
from parallel_robot.bags.run import recording, run_windows
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.trust import check_held_code, custom_files
from parallel_robot.live import source
from parallel_robot.live.frames import Camera, Motion
from parallel_robot.live.source import RefusedError
from parallel_robot_control.configuration import (
    ControlConfiguration,
    available,
    changed,
    configure,
)
from parallel_robot_control.laws import title
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import BagError, WholeNeededError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.config import default
from parallel_robot_model.configuration.fields import corrected
from parallel_robot_sim.motions import differs

# A long bag as the page needs it: the states around a moment, read when they are shown.

AHEAD = 30.0  # s after a moment that are read with it
BACK = (10.0, 1000.0, math.inf)  # s before the end, where the last state is looked for


class BagWindows:
    """Parts of a bag."""

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
        # what it holds, with its first states
        self.begun = next(recording.chunks(bag, AHEAD, motion_only=True, view=view))
        self.first = float(self.begun.log.time[0])  # time of its first state [s]
        end = self._end()
        # last: time of its last state [s]; last_stamp: stamp of that [ns]
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


PAST = 12.0  # s before a moment that is sought, for the curves
SPEEDS = (0.001, 100.0)  # slowest, fastest
NEAR = 1.0  # s before and after what is shown that are at hand
LONGEST = 1.0  # s that reading a long bag may take; else it plays more slowly


class BagSource:
    """Plays a run from any moment, at any speed."""

    def __init__(
        self,
        log: RunLog,
        past: History,
        configuration: ControlConfiguration,
        clock: Callable[[], float] = time.monotonic,
        windows: BagWindows | None = None,
    ) -> None:
        """Prepare to play from the start.

        Args:
            log: The run; of one that is read in windows, its first states.
            past: What happened beside the motion.
            configuration: Of its controller at the first state.
            clock: Time [s].
            windows: Where its other states are; None: the log has them all.
        """
        self._past, self._configuration = past, configuration
        self._clock, self._windows = clock, windows
        guess = np.array(configuration.guess)
        self._camera = Camera(configuration.robot, guess, log.joints)
        self._ghost = ''
        self._torques: dict[str, Array | Torques] = {}
        self._take(log)
        self._seen = not recorded_motions.of_plant(past) or differs(log.config)
        self._first, self._duration = self._held = float(log.time[0]), float(log.time[-1])
        last = int(log.stamps[-1])
        if windows is not None:
            self._first, self._duration, last = windows.first, windows.last, windows.last_stamp
        parts = run_windows.stretches(past, log.law, log.start_stamp, last)
        self._changes = [[one.begin, printable(one.change)] for one in parts[1:]]
        self._starts = np.array([status.stamp for status in past.statuses], dtype=np.int64)
        self._speed, self._playing = 1.0, True
        self._now, self._shown = self._first, -1
        self._looked = clock()
        self._anew = True

    def look(self) -> list[bytes]:
        """Frames since the last call; after a jump, those of the past, too."""
        now = self._clock()
        if self._playing:
            passed = (
                now - self._looked if self._windows is None else min(now - self._looked, LONGEST)
            )
            self._now = min(self._now + self._speed * passed, self._duration)
            self._playing = self._now < self._duration
        self._looked = now
        self._hold()
        newest = int(np.searchsorted(self._log.time, self._now, side='right')) - 1
        newest = min(max(newest, 0), len(self._log.time) - 1)
        if self._anew:
            return self._begin(newest)
        if newest <= self._shown:
            return []
        first, self._shown = self._shown + 1, newest
        return self._frames(first, newest + 1)

    def texts(self) -> dict[str, Any]:
        """Layout, state and setup; duration and speed."""
        stamp = self._log.stamps[max(self._shown, 0)]
        known = int(np.searchsorted(self._starts, stamp, side='right')) - 1
        status = self._past.statuses[known] if known >= 0 else None
        law = status.law if status else self._log.law
        fault = '' if status is None or status.fault == NO_FAULT else status.fault_text
        return {
            'layout': source.frame_layout(self._camera),
            'state': {
                'law': law,
                'title': title(law),
                'fault': fault,
                'limits': '',
                'lag': [],
                'answered': '',
                'skipped': '',
                'nodes': [],
                'ghost': self._ghost,
                'trouble': '',
            },
            'setup': {
                'scenario': self._log.scenario,
                'robot': str(self._log.config['robot_model']),
                'preset': '',
                'laws': [
                    {'name': name, 'title': title(name)} for name in self._configuration.laws
                ],
                'gains': {},
                'shape': '',
                'shapes': {},
                'seen': self._seen,
            },
            'bag': {
                'duration': self._duration,
                'playing': self._playing,
                'speed': self._speed,
                'changes': self._changes,
            },
        }

    async def act(self, action: str, value: Any) -> str:
        """Do what a browser asks for, with a value that nobody has checked; say what was done.

        Raises:
            RefusedError: it is not done.
            KeyError: there is no such action.
        """
        do = {
            'play': self._play,
            'seek': self._seek,
            'step': self._step,
            'speed': self._set_speed,
            'ghost': self._set_ghost,
        }[action]
        return await do(value)

    def _begin(self, newest: int) -> list[bytes]:
        """Frames of the seconds before a state, with a layout of their own."""
        self._anew = False
        self._camera.number += 1
        self._camera.begin()
        first = int(np.searchsorted(self._log.time, self._log.time[newest] - PAST))
        self._shown = newest
        return self._frames(first, newest + 1)

    def _frames(self, first: int, stop: int) -> list[bytes]:
        motion = self._motion.part(slice(first, stop))
        before = self._log.time[max(first - 1, 0)]
        return self._camera.frames(motion, float(motion.time[-1] - before))

    async def _play(self, value: Any) -> str:
        if value is True and self._now >= self._duration:
            self._now, self._anew = self._first, True
        self._playing = value is True
        return 'plays' if self._playing else 'paused'

    async def _seek(self, value: Any) -> str:
        self._now = min(max(_number(value), self._first), self._duration)
        self._anew = True
        return f'{self._now:.3f} s'

    async def _step(self, value: Any) -> str:
        """One state on, or back; the motion pauses."""
        row = max(self._shown, 0) + (1 if _number(value) > 0.0 else -1)
        self._playing = False
        row = min(max(row, 0), len(self._log.time) - 1)
        self._now = float(self._log.time[row])
        self._anew = row < self._shown
        return f'{self._now:.3f} s'

    async def _set_speed(self, value: Any) -> str:
        low, high = SPEEDS
        if not low <= _number(value) <= high:
            raise RefusedError(f'the speed must be from {low:g} to {high:g}, not {value!r:.40}')
        self._speed = float(value)
        return f'{self._speed:g}'

    async def _set_ghost(self, value: Any) -> str:
        """Show what a law would have asked for, from the first state on."""
        if not isinstance(value, str) or value not in {'', *self._configuration.laws}:
            raise RefusedError(f'the law {value!r:.40} is not known here')
        if value and value not in self._torques:
            configured = changed(self._configuration, {'law': value})
            try:
                self._torques = {value: await asyncio.to_thread(self._answered, configured)}
            except BagError as error:
                raise RefusedError(str(error)) from None
        self._ghost = value
        self._take(self._log)
        self._anew = True
        return value or 'off'

    def _answered(self, configured: ControlConfiguration) -> Array | Torques:
        """Torques of another law."""
        if self._windows is not None:
            return self._windows.answered(configured)
        return replayed.instead(self._log, self._past, configured).torque

    def _take(self, log: RunLog) -> None:
        """Show states of a log from here on."""
        ghost = self._torques.get(self._ghost, np.full_like(log.effort, np.nan))
        self._log = log
        self._motion = Motion(
            log.time,
            corrected(log.config, log.position),
            log.reference_position,
            log.effort,
            ghost.at(log.time) if isinstance(ghost, Torques) else ghost,
        )

    def _hold(self) -> None:
        """Read the states around the moment, if they are not at hand."""
        low, high = max(self._now - PAST, self._first), min(self._now + NEAR, self._duration)
        if self._windows is None or (self._held[0] <= low and high <= self._held[1]):
            return
        shown = self._now if self._anew else float(self._log.time[self._shown])
        self._held = min(low, shown) - NEAR, self._now + AHEAD
        log = self._windows.between(*self._held)
        if log is not None:
            self._take(log)
            self._shown = int(np.searchsorted(log.time, shown, side='right')) - 1


def open_bag(
    stack: ExitStack,
    bag: Path,
    trust: bool,
    view: BagView = AS_RECORDED,
    clock: Callable[[], float] = time.monotonic,
) -> BagSource:
    """Read a bag that is to be played.

    Args:
        stack: Removes what must be removed when the page ends.
        bag: Directory of the bag, or one file of it.
        trust: Whether code that it holds may run.
        view: What it does not say itself, and which part is shown.
        clock: Time [s].

    Raises:
        BagError: it is not a bag of a run, or needs code that may not run.
    """
    windows = _windows(bag, view)
    log, past, _ = windows.begun if windows else recording.read(bag, motion_only=True, view=view)
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    files = custom_files(bag, past.sources, log.config, folder, trust)
    values = bag_replay.configuration(log, past, files, {})
    if not past.facts and values['law'] == UNKNOWN_LAW:  # the robot is shown, whatever moved it
        law = past.statuses[0].law if past.statuses else ''
        values['law'] = law if law in available(values['custom_laws']) else default('law')
    check_held_code(bag, values)
    return BagSource(log, past, configure(values), clock, windows)


def _windows(bag: Path, view: BagView) -> BagWindows | None:
    """A bag in windows; None if it is short, or cannot be read so."""
    try:
        return BagWindows(bag, view) if evaluated_bag.long(bag, view) else None
    except BagError:
        return None


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e9:
        raise RefusedError(f'{value!r:.40} is not a number that is taken')
    return float(value)
