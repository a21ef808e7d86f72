"""What of a bag can be used to identify a robot: stretches of motion under known torques."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

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

Part = TypeVar('Part')


@dataclass(frozen=True)
class MeasuredMotion:
    """Joints and torques over time."""

    time: Array  # stamps, increasing [s], shape (N,)
    position: Array  # measured joints [rad], shape (N, n)
    effort: Array  # torque in the step that ended at the stamp [N m], shape (N, n)
    usable: NDArray[np.bool_]  # whether the torque of that step is known and meant, shape (N,)


def rows_of(part: Part, some: slice | NDArray[np.bool_]) -> Part:
    """Some rows of a dataclass of arrays, of which each has a row for each time."""
    return type(part)(*(each[some] for each in vars(part).values()))


def joined(parts: Sequence[Part]) -> Part:
    """Such parts that follow each other as one."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))


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
        """
        self.period, self._kept, self._stop = period, KeptParts('the motion'), np.inf
        self.count = 0  # samples that are usable
        bad = {'after a fault': 0, SATURATION: 0}
        most, varies = np.zeros(len(torque_limit)), np.zeros(len(torque_limit), bool)
        before = level = np.zeros((0, len(torque_limit)))
        speed, times, newest = _Speed(period), np.zeros(0), FIRST
        states, gaps = 0, np.zeros(0)
        changes, again, wrapped = 0, 0, False
        joints: tuple[str, ...] = ()
        units: JointUnits = HINGES
        for log in windows:
            joints, units, stamps = log.joints, log.units, log.stamps
            newest_before = np.maximum.accumulate(np.append(newest, stamps))
            newer, newest = stamps > newest_before[:-1], newest_before[-1]
            if not newer.any():
                continue
            some = slice(None) if newer.all() else newer  # copies nothing
            time, effort = log.time[some], log.effort[some]
            position, leaps = _unwrapped(np.vstack([before, log.position[some] - zero]), units)
            position, wrapped = position[len(before) :], wrapped or leaps
            before = position[-1:]
            faulted = _faulted(stamps[some], statuses)
            saturated = ~faulted & (np.abs(effort) >= SATURATED * torque_limit).any(axis=1)
            motion = MeasuredMotion(time, position, effort, ~(faulted | saturated))
            steps = np.diff(np.append(times[1:], time))
            gaps = np.append(gaps, steps[steps > GAP * period])
            times = np.array([times[0] if states else time[0], time[-1]])
            states, self.count = states + len(time), self.count + int(motion.usable.sum())
            bad['after a fault'] += int(faulted.sum())
            bad[SATURATION] += int(saturated.sum())
            level = level if len(level) else effort[:1]
            varies |= (np.abs(effort - level) > NOTHING).any(axis=0)
            changed = (np.diff(position, axis=0) != 0.0).any(axis=1)
            changes += int(changed.sum())
            again += int((changed[1:] & changed[:-1]).sum())
            most = np.maximum(most, np.abs(effort).max(axis=0))
            speed.add(motion)
            self._kept.add(*vars(motion).values())
        if states < 2:
            raise BagError('it holds a single joint state')
        self.begin, self.duration = float(times[0]), float(times[1] - times[0])  # [s]
        self.speed = speed.rms()  # rms of the rate of each joint [rad/s], shape (n,)
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
        left_out = [
            f'{n * period:.3g} s: {what}{beyond if what == SATURATION else ""}'
            for what, n in bad.items()
            if n
        ]
        if len(gaps):
            many = f'{len(gaps)} gaps' if len(gaps) > 1 else 'a gap'
            left_out.append(f'{sum(gaps):.3g} s: {many} between states')
        self.left_out = tuple(left_out)  # what is not usable, one line each
        if not self.count:
            raise BagError(f'none of it can be used: {"; ".join(left_out)}')
        self.doubts = []
        if wrapped:
            self.doubts.append('joints leap by a whole turn: leaps are taken out')
        if 2 * again < changes:
            what = f'positions change in {changes} of {states} states'
            self.doubts.append(f'{what}: were they measured less often than they are told?')

    def before(self, stop: float) -> RunMotion:
        """What of it is before a time [s]; its figures stay those of the whole."""
        part = copy.copy(self)
        part._stop = stop
        return part

    def windows(self) -> Iterator[MeasuredMotion]:
        """Parts that follow each other, from the first one on each time."""
        for columns in self._kept:
            part = MeasuredMotion(*columns)
            if part.time[-1] < self._stop:
                yield part
            elif part.time[0] < self._stop:
                yield rows_of(part, part.time < self._stop)


class _Speed:
    """rms of the rate of each joint over SPAN, window by window."""

    def __init__(self, period: float) -> None:
        self._step = max(1, round(SPAN / period)) if period > 0.0 else 1
        self._last: list[MeasuredMotion] = []
        self._squares: Array | float = 0.0
        self._count = 0

    def add(self, motion: MeasuredMotion) -> None:
        """Take the next window."""
        motion = joined([*self._last, motion])
        self._take(motion, self._step)
        self._last = [rows_of(motion, slice(-self._step, None))]

    def _take(self, motion: MeasuredMotion, step: int) -> None:
        way = motion.position[step:] - motion.position[:-step]
        rate = way / (motion.time[step:] - motion.time[:-step])[:, np.newaxis]
        self._squares = self._squares + (rate**2).sum(axis=0)
        self._count += len(rate)

    def rms(self) -> Array:
        """The speed, shape (n,)."""
        if not self._count:  # shorter than SPAN
            self._take(self._last[0], len(self._last[0].time) - 1)
        return np.sqrt(self._squares / self._count)


def stretches(motion: RunMotion, shortest: int) -> Iterator[MeasuredMotion]:
    """Parts of a motion without gaps that can be used, each at least `shortest` samples long."""
    longest = GAP * motion.period
    kept: list[MeasuredMotion] = []
    for window in motion.windows():
        *whole, last = _unbroken(joined([*kept, window]), longest)
        yield from (part for part in whole if len(part.time) >= shortest)
        kept = [last]
    yield from (part for part in kept if len(part.time) >= shortest)


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
        found += [rows_of(motion, slice(*pair)) for pair in itertools.pairwise(cuts)]
    return found


def _unwrapped(position: Array, units: JointUnits) -> tuple[Array, bool]:
    """Positions whose hinges do not leap by a whole turn, and whether they did."""
    hinges = units.hinges(position.shape[1])
    if not (hinges & (np.abs(np.diff(position, axis=0)) > WRAPPED)).any():
        return position, False
    return np.where(hinges, np.unwrap(position, WRAPPED, axis=0), position), True


def _faulted(stamps: NDArray[np.int64], statuses: Sequence[ControllerStatus]) -> NDArray[np.bool_]:
    if not statuses:
        return np.zeros(len(stamps), bool)
    begins = np.array([status.stamp for status in statuses])
    faulted = np.array([False, *(status.fault != NO_FAULT for status in statuses)])
    return faulted[np.searchsorted(begins, stamps, side='right')]
