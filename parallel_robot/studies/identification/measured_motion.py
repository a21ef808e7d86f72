"""What of a bag can be used to identify a robot: stretches of motion under known torques."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.history import ControllerStatus
from parallel_robot.bags.limits import KeptParts
from parallel_robot.bags.messages.message_arrays import FIRST
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import HINGES, TURN, Array, JointUnits

GAP = 5.5  # periods without a state, beyond which the motion between them is not known
LONGEST = 100_000  # samples of a stretch, which bounds the memory
SATURATED = 1.0 - 1e-6  # of the limit of the motors
SATURATION = 'motors saturated'
STILL = 2e-3  # rad/s, rms of a joint that stands still
NOTHING = 1e-9  # N m, by which torques that are one differ
WRAPPED = 0.75 * TURN  # rad, a step that is one of a whole turn
SPAN = 0.1  # s over which its rate is taken, so that noise does not count as motion


@dataclass(frozen=True)
class MeasuredMotion:
    """Joints and torques over time."""

    time: Array  # stamps, increasing [s], shape (N,)
    position: Array  # measured joints [rad], shape (N, n)
    effort: Array  # torque in the step that ended at the stamp [N m], shape (N, n)
    usable: NDArray[np.bool_]  # whether the torque of that step is known and meant, shape (N,)
    left_out: tuple[str, ...] = ()  # what is not usable, one line each

    @property
    def period(self) -> float:
        """Time between two samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def speed(self) -> Array:
        """rms of the rate of each joint [rad/s], shape (n,)."""
        speed = _Speed(self.period)
        speed.add(self)
        return speed.rms()

    @property
    def duration(self) -> float:
        """Time between the first sample and the last one [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def count(self) -> int:
        """How many samples are usable."""
        return int(self.usable.sum())

    def windows(self) -> Iterator[MeasuredMotion]:
        """All of it, at once."""
        yield self

    def rows(self, some: slice | NDArray[np.bool_]) -> MeasuredMotion:
        """Some of the samples."""
        return MeasuredMotion(
            self.time[some], self.position[some], self.effort[some], self.usable[some]
        )


class RunMotion:
    """Motion of a run that may be too long to be held in memory."""

    def __init__(
        self,
        windows: Iterable[RunLog],
        period: float,
        statuses: Sequence[ControllerStatus],
        torque_limit: Array,
        zero: Array | float = 0.0,
    ) -> None:
        """Look through the run.

        Args:
            windows: Its windows.
            period: Time between two states [s].
            statuses: Statuses of the controller, in order.
            torque_limit: Saturation of the motors [N m], shape (n,).
            zero: Zero angles, which are taken off the positions [rad], shape (n,).

        Raises:
            BagError: no torque was recorded, none can be used, or the robot did not move.
            InputError: there is no room to keep it.
        """
        # as of :class:`MeasuredMotion`, like the others
        self.period, self._kept = period, KeptParts('the motion')
        self._statuses, self._limit, self._zero = statuses, torque_limit, zero
        states, self.count, self.duration, self._wrapped = 0, 0, 0.0, False
        bad = {'after a fault': 0, SATURATION: 0}
        most, level = np.zeros(len(torque_limit)), np.zeros((0, len(torque_limit)))
        varies = np.zeros(len(torque_limit), bool)
        speed, begin, last = _Speed(period), None, np.inf
        changes = again = 0
        gaps: list[float] = []
        joints: tuple[str, ...] = ()
        units: JointUnits = HINGES

        def noted() -> Iterator[RunLog]:
            nonlocal joints, units
            for log in windows:
                joints, units = log.joints, log.units
                yield log

        for motion, faulted in self._parts(noted()):
            begin = motion.time[0] if begin is None else begin
            steps = np.diff(motion.time, prepend=last)
            gaps += steps[steps > GAP * period].tolist()
            last = motion.time[-1]
            self.duration = float(motion.time[-1] - begin)
            states, self.count = states + len(motion.time), self.count + motion.count
            bad['after a fault'] += int(faulted.sum())
            bad[SATURATION] += int((~motion.usable & ~faulted).sum())
            level = level if len(level) else motion.effort[:1]
            varies |= (np.abs(motion.effort - level) > NOTHING).any(axis=0)
            changed = (np.diff(motion.position, axis=0) != 0.0).any(axis=1)
            changes += int(changed.sum())
            again += int((changed[1:] & changed[:-1]).sum())
            most = np.maximum(most, np.abs(motion.effort).max(axis=0))
            speed.add(motion)
            self._kept.add(motion.time, motion.position, motion.effort, motion.usable)
        if states < 2:
            raise BagError('it holds a single joint state')
        self.speed = speed.rms()
        none = (np.abs(level[0]) <= NOTHING) & ~varies
        stuck = none | (~varies & (self.speed >= STILL))
        if stuck.any():
            silent = ', '.join(joint for joint, one in zip(joints, stuck, strict=True) if one)
            what = 'zero' if none[stuck].all() else 'one number'
            raise BagError(f'the effort of {silent} is {what} in every joint state')
        if (self.speed < STILL).all():
            still = f'{STILL:g} {units.of("rad/s")}'
            where = f'{states} states in {self.duration:.4g} s'
            raise BagError(f'the robot stood still: no joint reached {still} (rms); {where}')
        beyond = ''
        if (most > 1.01 * torque_limit).any():
            k = int(np.argmax(most / torque_limit))
            unit = units.one(k).of('N m')
            told = f'efforts reach {most[k]:.4g} {unit}, more than plant.torque_limit'
            beyond = f' ({told}, {torque_limit[k]:g} {unit}: are they in {unit}?)'
        self.left_out = tuple(
            f'{n * period:.3g} s: {what}{beyond if what == SATURATION else ""}'
            for what, n in bad.items()
            if n
        )
        if gaps:
            many = f'{len(gaps)} gaps' if len(gaps) > 1 else 'a gap'
            self.left_out += (f'{sum(gaps):.3g} s: {many} between states',)
        if not self.count:
            raise BagError(f'none of it can be used: {"; ".join(self.left_out)}')
        self.doubts = []
        if self._wrapped:
            self.doubts.append('joints leap by a whole turn: leaps are taken out')
        if 2 * again < changes:
            what = f'positions change in {changes} of {states} states'
            self.doubts.append(f'{what}: were they measured less often than they are told?')

    def windows(self) -> Iterator[MeasuredMotion]:
        """Parts that follow each other, from the first one on each time."""
        for time, position, effort, usable in self._kept:
            yield MeasuredMotion(time, position, effort, usable)

    def _parts(self, logs: Iterator[RunLog]) -> Iterator[tuple[MeasuredMotion, NDArray[np.bool_]]]:
        """Motion in each window, and which of its states were in a fault."""
        newest, before = FIRST, np.zeros((0, len(self._limit)))
        for log in logs:
            stamps = log.stamps
            newest_before = np.maximum.accumulate(np.append(newest, stamps))
            newer = stamps > newest_before[:-1]
            newest = newest_before[-1]
            if not newer.any():
                continue
            chosen = slice(None) if newer.all() else newer  # copies nothing
            effort = log.effort[chosen]
            faulted = _faulted(stamps[chosen], self._statuses)
            saturated = (np.abs(effort) >= SATURATED * self._limit).any(axis=1)
            both = np.vstack([before, log.position[chosen] - self._zero])
            position = self._unwrapped(both, log.units)[len(before) :]
            before = position[-1:]
            usable = ~(faulted | saturated)
            yield MeasuredMotion(log.time[chosen], position, effort, usable), faulted

    def _unwrapped(self, position: Array, units: JointUnits) -> Array:
        """Positions whose hinges do not leap by a whole turn."""
        hinges = ~np.array(units.slides or (False,) * position.shape[1])
        if not (hinges & (np.abs(np.diff(position, axis=0)) > WRAPPED)).any():
            return position
        self._wrapped = True
        return np.where(hinges, np.unwrap(position, WRAPPED, axis=0), position)


@dataclass(frozen=True)
class Begin:
    """What of a motion is before a time."""

    whole: Motion
    stop: float  # the time [s]

    def __getattr__(self, name: str) -> Any:
        """Period, speed and what is left out, of the whole; `count` and `duration` likewise."""
        return getattr(self.whole, name)

    def windows(self) -> Iterator[MeasuredMotion]:
        """Parts that follow each other."""
        for window in self.whole.windows():
            if window.time[0] < self.stop:
                yield window.rows(window.time < self.stop)


class _Speed:
    """rms of the rate of each joint over SPAN, window by window."""

    def __init__(self, period: float) -> None:
        self._step = max(1, round(SPAN / period)) if period > 0.0 else 1
        self._last: MeasuredMotion | None = None
        self._squares: Array | float = 0.0
        self._count = 0

    def add(self, motion: MeasuredMotion) -> None:
        """Take the next window."""
        motion = motion if self._last is None else joined(self._last, motion)
        self._take(motion, self._step)
        self._last = motion.rows(slice(-self._step, None))

    def _take(self, motion: MeasuredMotion, step: int) -> None:
        way = motion.position[step:] - motion.position[:-step]
        rate = way / (motion.time[step:] - motion.time[:-step])[:, np.newaxis]
        self._squares = self._squares + (rate**2).sum(axis=0)
        self._count += len(rate)

    def rms(self) -> Array:
        """The speed, shape (n,)."""
        if not self._count and self._last is not None:  # shorter than SPAN
            self._take(self._last, len(self._last.time) - 1)
        return np.sqrt(self._squares / self._count)


def joined(first: MeasuredMotion, second: MeasuredMotion) -> MeasuredMotion:
    """A part of a motion and the next one."""
    return MeasuredMotion(
        np.concatenate([first.time, second.time]),
        np.concatenate([first.position, second.position]),
        np.concatenate([first.effort, second.effort]),
        np.concatenate([first.usable, second.usable]),
    )


def stretches(motion: Motion, shortest: int) -> Iterator[MeasuredMotion]:
    """Parts of a motion without gaps that can be used, each at least `shortest` samples long."""
    longest = GAP * motion.period
    kept: MeasuredMotion | None = None
    for window in motion.windows():
        *whole, last = _unbroken(window if kept is None else joined(kept, window), longest)
        yield from (part for part in whole if len(part.time) >= shortest)
        kept = last
    if kept is not None and len(kept.time) >= shortest:
        yield kept


def _unbroken(motion: MeasuredMotion, longest: float) -> list[MeasuredMotion]:
    """Parts without gaps, at most LONGEST samples each; the last one may go on after the motion.

    A sample that cannot be used ends a part; one after a gap begins the next, as its position is
    known.
    """
    broken = ~motion.usable
    broken[1:] |= np.diff(motion.time) > longest
    found = []
    edges = np.flatnonzero(broken).tolist()
    for begin, end in zip([0, *edges], [*edges, len(broken)], strict=True):
        first = begin if begin == end or motion.usable[begin] else begin + 1
        cuts = [*range(first, max(end, first + 1), LONGEST), end]
        found += [motion.rows(slice(*pair)) for pair in itertools.pairwise(cuts)]
    return found


def _faulted(stamps: NDArray[np.int64], statuses: Sequence[ControllerStatus]) -> NDArray[np.bool_]:
    """Which states were in a fault, shape (N,)."""
    if not statuses:
        return np.zeros(len(stamps), bool)
    begins = np.array([status.stamp for status in statuses])
    faulted = np.array([False, *(status.fault != NO_FAULT for status in statuses)])
    return faulted[np.searchsorted(begins, stamps, side='right')]


Motion: TypeAlias = MeasuredMotion | RunMotion | Begin
