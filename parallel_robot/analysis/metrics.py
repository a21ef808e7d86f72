"""Metrics of a run: one table, from which texts, JSON, columns and measures are read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from parallel_robot.bags import columns
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.robots.contract import angles_between
from parallel_robot_sim.motions import Motion, Motions
from parallel_robot_sim.motions import Poses as Poses

TRUE: Literal['true'] = 'true'
SEEN: Literal['seen'] = 'seen'
SMOOTH = 0.02  # s, in which a torque that does not chatter hardly changes
BELOW = 0.5  # s, for which an error must stay below a bound before that counts as reached
UNSETTLED = 3.0  # ratio of the errors of a part's halves; if larger, the robot had not settled
STEP = 0.1  # s; what moves no longer than that is a step, of which the response is looked at
FEW = 0.01  # share of samples at which a reference of steps moves at most
SLOW = 0.01  # of the largest speed of a motion; one that ends slower comes to rest


class Block:
    """Consecutive samples of a motion; quantities have one row for each of them."""

    def __init__(self, part: MotionPart, rows: slice) -> None:
        around = slice(max(rows.start - part.half - 1, 0), rows.stop + part.half)
        self._half, self._around = part.half, part.motion.rows(around)
        self._ideal = None if part.ideal is None else part.ideal[around]
        self._rows = slice(rows.start - around.start, rows.stop - around.start)

    @cached_property
    def motion(self) -> Motion:
        """The samples."""
        return self._around.rows(self._rows)

    @cached_property
    def error(self) -> Array:
        """Errors of the joints [rad], shape (N, n)."""
        return self.motion.reference_position - self.motion.position

    @cached_property
    def synchronisation_error(self) -> Array:
        """Synchronisation errors of the joints [rad], shape (N, n)."""
        return synchronisation_error(self.error)

    @cached_property
    def distance(self) -> Array:
        """Distance of the end effector from its reference [m], shape (N,); NaN without a place."""
        return distances(self.motion.poses)

    @cached_property
    def rotation(self) -> Array:
        """Angle of the end effector to its reference [rad], shape (N,); NaN without one."""
        return rotation_errors(self.motion.poses)

    @cached_property
    def torque_steps(self) -> Array:
        """Changes of the torque to these samples from those before [N m], shape (N, n)."""
        since = max(self._rows.start - 1, 0)
        return np.diff(self._around.effort[since : self._rows.stop], axis=0)

    @cached_property
    def work(self) -> Array:
        """|torque x change of position| of each motor [J], shape (N, n)."""
        position = self._around.position
        return np.abs(self._around.effort * np.diff(position, axis=0, prepend=position[:1]))[
            self._rows
        ]

    @cached_property
    def chattering(self) -> Array:
        """Torque minus its moving mean over SMOOTH [N m], shape (N, n)."""
        return high_pass(self._around.effort, self._half)[self._rows]

    @cached_property
    def ideal_chattering(self) -> Array:
        """The same of the ideal torque, which has to be known."""
        assert self._ideal is not None
        return high_pass(self._ideal, self._half)[self._rows]


class MotionPart:
    """A motion and its window: the part of which most metrics are."""

    def __init__(self, motion: Motion, ideal: Array | None = None, first: int = 0) -> None:
        """Prepare.

        Args:
            motion: The motion.
            ideal: The ideal torque of each of its samples, see ideal_torque.py [N m],
                shape (N, n); None where it is not known.
            first: Number of the first sample of the window, which goes to the end.
        """
        self.motion, self.ideal, self.first = motion, ideal, first
        # samples on each side of a moving mean
        self.half = smooth_over(motion.time[: columns.BLOCK])
        self._blocks: dict[tuple[int, int], Block] = {}

    def blocks(self, first: int | None = None, stop: int | None = None) -> Iterator[Block]:
        """The samples from `first` (None: of the window) up to `stop` (None: to the end)."""
        begin = self.first if first is None else first
        stop = len(self.motion.time) if stop is None else stop
        for rows in columns.blocks(begin, stop):
            place = rows.start, rows.stop
            if place not in self._blocks:
                if len(self._blocks) > 1:  # of a motion that is longer, none is kept for long
                    self._blocks.pop(next(iter(self._blocks)))
                self._blocks[place] = Block(self, rows)
            yield self._blocks[place]

    def rms(
        self, of: Callable[[Block], Array], first: int | None = None, stop: int | None = None
    ) -> float:
        """Root mean square of a quantity over some samples, see :meth:`blocks`."""
        sums = [
            (float(np.sum(of(block) ** 2)), of(block).size) for block in self.blocks(first, stop)
        ]
        squares, counts = zip(*sums, strict=True)
        return math.sqrt(math.fsum(squares) / sum(counts))

    def total(self, of: Callable[[Block], Array], first: int | None = None) -> float:
        """Sum of a quantity."""
        return math.fsum(float(of(block).sum()) for block in self.blocks(first))

    def largest(self, of: Callable[[Block], Array], first: int | None = None) -> float:
        """Largest value of a quantity; NaN if one of them is."""
        return float(np.max([of(block).max() for block in self.blocks(first)]))


Value = Callable[[MotionPart], float | None]


class Metric(NamedTuple):
    """One metric; smaller is better.

    Its key, names and unit are those of hinges: ``metric.in_units(found.units)`` has those of a
    run's.
    """

    key: str  # in JSON, where it stands in its group, without the name of that; in other tables
    name: str  # full name
    unit: str  # unit as it is printed
    group: str  # of JSON
    value: Value  # None for a state never reached, NaN where it is not defined; in SI units
    short: str = ''  # heading of a narrow column; empty: only JSON has it
    # heading of a narrow column with the metric of what is seen, where that is another motion
    seen_short: str = ''
    seen: bool = False  # whether it is of what is seen: NaN where that is the true motion

    @property
    def scale(self) -> float:
        """Factor from SI units to the printed unit."""
        return 1e6 if self.unit.startswith('µ') else 1.0

    @property
    def of_motion(self) -> bool:
        """Whether it differs between the true motion and what is seen of it."""
        return self.group in ('transient', 'steady') or bool(self.seen_short)

    def as_seen(self) -> Metric:
        """The same of what is seen."""
        key, name = f'seen_{self.key}', f'seen {self.name}'
        return self._replace(key=key, name=name, short=self.seen_short, seen=True)

    def in_units(self, units: JointUnits) -> Metric:
        """The same of joints of some units; a rotation is an angle with all of them."""
        return self._replace(
            key=units.key(self.key),
            name=units.label(self.name),
            short=units.label(self.short),
            unit=self.unit if ROTATION in self.name else units.of(self.unit),
        )

    def of(self, found: Metrics) -> float:
        """Its value in a run in SI units; infinite if never reached, NaN if not defined."""
        key = self.key.removeprefix('seen_')
        value = found[key]
        if self.seen:
            if found.seen is None or (found.source == TRUE and found.seen[key] == value):
                return math.nan
            value = found.seen[key]
        elif self.of_motion and found.source == SEEN:
            return math.nan
        return math.inf if value is None else value

    def printed(self, found: Metrics) -> float:
        """The same in its printed unit."""
        return self.scale * self.of(found)


ROTATION = 'end-effector rotation error'


def _excess_chattering(part: MotionPart) -> float:
    """Root mean square of the chattering that does not help [N m]; NaN without ideal torque.

    A torque that cancels a disturbance changes as quickly as the disturbance; that is no fault.
    Of what the torque differs from its moving mean, as much of that of the ideal torque is taken
    away for each joint as leaves least, from none of it to all of it:

        min_s rms(high_pass(torque) - s high_pass(ideal)),    0 <= s <= 1

    The chattering of the difference, s = 1, would call it effort when a law does nothing about a
    disturbance; a difference of two chatterings would let noise take the place of what a law does
    not cancel. With s, noise counts in full, a torque that does nothing not at all, and a torque
    that comes too late as far as it is out of phase.
    """
    if part.ideal is None:
        return math.nan
    most = alike = np.zeros(part.ideal.shape[1])
    for block in part.blocks():
        most = most + np.sum(block.ideal_chattering**2, axis=0)
        alike = alike + np.sum(block.chattering * block.ideal_chattering, axis=0)
    share = np.clip(np.divide(alike, most, out=np.zeros_like(most), where=most > 0.0), 0.0, 1.0)
    return part.rms(lambda block: block.chattering - share * block.ideal_chattering)


def _settled(bound: float) -> Value:
    """Time from which on the distance stays below `bound` [m] to the end, for BELOW or more [s].

    None if it does not, NaN of NaN.
    """

    def settling_time(part: MotionPart) -> float | None:
        time, first, start = part.motion.time, 0, 0
        for block in part.blocks(0):
            if np.isnan(block.distance).any():
                return math.nan
            above = np.flatnonzero(block.distance >= bound)
            if above.size:
                first = start + int(above[-1]) + 1
            start += len(block.distance)
        if not first:
            return 0.0
        stays = first < len(time) and time[-1] - time[first] >= BELOW - 1e-9
        return float(time[first] - time[0]) if stays else None

    return settling_time


def _variation(part: MotionPart) -> float:
    """Sum over the joints of |change of torque|, per second [N m/s]."""
    duration = float(part.motion.time[-1] - part.motion.time[0])
    return part.total(lambda block: np.abs(block.torque_steps), 0) / duration if duration else 0.0


TABLE = (
    # time after which the distance stays below a bound, for BELOW or more
    Metric('to_1_mm_s', 'time to 1 mm', 's', 'transient', _settled(1e-3), 'to 1 mm', 'seen 1 mm'),
    Metric(
        'to_0_1_mm_s', 'time to 0.1 mm', 's', 'transient', _settled(1e-4), 'to 0.1 mm', 'seen 0.1'
    ),
    # distance of the end effector from its reference
    Metric(
        'xy_rms_m', 'end-effector error, rms', 'µm', 'steady',
        lambda part: part.rms(lambda block: block.distance), 'rms', 'seen rms',
    ),
    Metric(
        'xy_max_m', 'end-effector error, max', 'µm', 'steady',
        lambda part: part.largest(lambda block: block.distance), 'max', 'seen max',
    ),
    # angle by which the end effector is turned from its reference
    Metric(
        'rotation_rms_rad', f'{ROTATION}, rms', 'µrad', 'steady',
        lambda part: part.rms(lambda block: block.rotation), 'rot rms', 'seen rot',
    ),
    Metric(
        'rotation_max_rad', f'{ROTATION}, max', 'µrad', 'steady',
        lambda part: part.largest(lambda block: block.rotation),
    ),
    # over all joints
    Metric(
        'joint_rms_rad', 'joint error, rms', 'µrad', 'steady',
        lambda part: part.rms(lambda block: block.error), 'joint rms', 'seen joint',
    ),
    Metric(
        'sync_rms_rad', 'synchronisation error, rms', 'µrad', 'steady',
        lambda part: part.rms(lambda block: block.synchronisation_error), 'sync rms', 'seen sync',
    ),
    Metric(
        'torque_max_nm', 'torque, max (whole run)', 'N m', 'torque',
        lambda part: part.largest(lambda block: np.abs(block.motion.effort), 0), 'torque',
    ),
    Metric(
        'torque_total_variation_nm_per_s', 'torque, total variation', 'N m/s', 'torque',
        _variation, 'variation',
    ),
    Metric(
        'chattering_nm', 'torque, chattering', 'N m', 'torque',
        lambda part: part.rms(lambda block: block.chattering), 'chatter',
    ),
    Metric(
        'torque_rms_nm', 'torque, rms', 'N m', 'effort',
        lambda part: part.rms(lambda block: block.motion.effort), 'torque rms',
    ),
    # mechanical work of all motors, braking as dear as driving: the sum over the joints of the
    # integral of |torque x rate|. The torque is constant over a period, so that is
    # |torque x change of the position|, summed
    Metric(
        'energy_j', 'energy', 'J', 'effort',
        lambda part: part.total(lambda block: block.work), 'energy', 'seen J',
    ),
    Metric(
        'excess_chattering_nm', 'excess chattering', 'N m', 'effort', _excess_chattering, 'excess'
    ),
)  # fmt: skip
# All that tables have, those of what is seen behind those of the true motion.
METRICS = (
    *(metric for metric in TABLE if metric.short),
    *(metric.as_seen() for metric in TABLE if metric.seen_short),
)


def named(*keys: str) -> list[Metric]:
    """Metrics by their keys.

    Raises:
        UnknownNameError: there is no such metric.
    """
    known = {metric.key: metric for metric in METRICS}
    for key in keys:
        if key not in known:
            raise UnknownNameError('metric', key, known)
    return [known[key] for key in keys]


class Window(NamedTuple):
    """Over which part of a run errors, chattering and effort are taken: its window."""

    start_s: float  # its begin [s]
    stop_s: float  # its end [s]
    run_s: float  # duration of all of the run, also of what is not looked at [s]
    # whether somebody asked for this part; then all metrics are of it alone. Else it is the
    # second half of the motion: from the first time at which the reference moves to that
    # from which on it rests for good
    requested: bool = False
    rests: bool = False  # whether the reference rests before or after the motion
    # root mean square joint errors of its halves [rad], where the second is much less: the
    # robot had not settled; None where it had
    unsettled: tuple[float, float] | None = None


@dataclass(frozen=True)
class Metrics:
    """All metrics of a run, of its motion: without what follows where that has come to rest.

    ``found['xy_rms_m']`` is one of them, in SI units; None for a state never reached, NaN where
    it is not defined.
    """

    values: dict[str, float | None]  # of the rows of TABLE, by key
    duration_s: float  # duration of the motion [s]
    # over which part errors, chattering and effort are taken
    window: Window
    # units of the joints: what is said to be in rad and N m is in m and N of slides
    units: JointUnits = HINGES
    # TRUE: of the true motion; SEEN: of what sensors and nominal robot show
    source: Literal['true', 'seen'] = TRUE
    # those of what is seen; None where all that is seen is true
    seen: Metrics | None = field(default=None, repr=False)

    def __getitem__(self, key: str) -> float | None:
        """One of them by its key, that of hinges or that in the units of the joints.

        Raises:
            UnknownNameError: there is no such metric.
        """
        if key in self.values:
            return self.values[key]
        own = {self.units.key(name): name for name in self.values}
        if key not in own:
            raise UnknownNameError('metric', key, own)
        return self.values[own[key]]


def figures(motions: Motions, start: float | None = None, stop: float | None = None) -> Metrics:
    """Compute the metrics of a run: of its true motion, and of what is seen of it.

    Where the true motion is not known, all metrics are of what is seen. A motion that has come
    to rest is looked at up to there.

    Args:
        motions: The run.
        start: Time from which on it is looked at [s]; None: from its first sample on.
        stop: Time up to which it is looked at [s]; None: up to its last sample.

    Raises:
        InputError: there is none of the run between `start` and `stop`.
    """
    whole, requested = motions.best, start is not None or stop is not None
    end = None if requested else _reference_moves(whole)[1]
    if requested or end is not None:
        first = -math.inf if start is None else start
        last = stop if end is None else end
        motions = _between(motions, first, math.inf if last is None else last)
    seen = None if motions.seen is None else evaluate(motions.seen, all_of_it=requested)
    if motions.true is None:
        assert seen is not None
        found = replace(seen, source=SEEN, seen=seen)
    else:
        found = replace(evaluate(motions.true, motions.ideal, requested), seen=seen)
    run = float(whole.time[-1] - whole.time[0])
    rests = found.window.rests or end is not None
    window = found.window._replace(run_s=run, requested=requested, rests=rests)
    return replace(found, window=window)


def _between(motions: Motions, first: float, last: float) -> Motions:
    """The part of a run between two times [s], both included."""
    end, time = np.nextafter(last, math.inf), motions.best.time
    part = motions.between(first, end)
    if not first < last or not len(part.best.time):
        raise InputError(
            f'the run is from {time[0]:g} to {time[-1]:g} s; there is no part of it from '
            f'{max(first, time[0]):g} to {min(last, time[-1]):g} s'
        )
    if part.seen is not None and not len(part.seen.time):
        part = part._replace(seen=None)
    return part


def evaluate(motion: Motion, ideal: Array | None = None, all_of_it: bool = False) -> Metrics:
    """Compute the metrics of a motion.

    Args:
        motion: The motion.
        ideal: The ideal torque of each of its samples, see ideal_torque.py [N m], shape (N, n);
            None where it is not known.
        all_of_it: Whether the window is all of it, else the second half of its motion.
    """
    time = motion.time
    begin = 0 if all_of_it else _reference_moves(motion)[0]
    part = MotionPart(motion, ideal, 0 if all_of_it else (begin + len(time)) // 2)
    values = {metric.key: metric.value(part) for metric in TABLE}
    for key, value in values.items():
        if value != value:
            values[key] = math.nan  # one object, so that equal metrics are equal
    length = float(time[-1] - time[0])
    window = Window(
        float(time[part.first]),
        float(time[-1]),
        length,
        rests=begin > 0,
        unsettled=None if all_of_it else _unsettled(part),
    )
    return Metrics(values, length, window, motion.poses.units)


def _reference_moves(motion: Motion) -> tuple[int, float | None]:
    """Where the reference of a motion moves, but for steps.

    Returns:
        The sample from which on it moves, 0 where it does not; and the time from which on it rests
        to the end [s], None where it moves on.
    """
    first = after = count = 0
    for rows in columns.blocks(1, len(motion.time)):
        steps = np.diff(motion.reference_position[rows.start - 1 : rows.stop], axis=0)
        moves = np.flatnonzero(steps.any(axis=1))
        if moves.size:
            first = first if count else rows.start - 1 + int(moves[0])
            after = rows.start + int(moves[-1])
            count += moves.size
    lasts = motion.time[after] - motion.time[first]
    if not count or lasts < STEP or count < FEW * (after - first):
        return 0, None
    return first, float(motion.time[after]) if after + 1 < len(motion.time) else None


def _unsettled(part: MotionPart) -> tuple[float, float] | None:
    """Errors of the halves of a window [rad], where the robot had not settled; else None."""
    fastest, last = 0.0, math.nan
    for block in part.blocks(0):
        steps = np.diff(block.motion.reference_position, axis=0)
        if len(steps):
            speeds = np.abs(steps).max(axis=1, initial=0.0)
            fastest, last = max(fastest, float(speeds.max())), float(speeds[-1])
    if last < SLOW * fastest:
        return None  # errors fall with the speed
    count = len(part.motion.time)
    middle = part.first + (count - part.first + 1) // 2
    before = part.rms(lambda block: block.error, part.first, middle)
    after = part.rms(lambda block: block.error, middle) if middle < count else 0.0
    return (before, after) if before > UNSETTLED * after > 0.0 else None


def distances(pose: Poses) -> Array:
    """Distance of the end effector from its reference [m], shape (N,); NaN without a place."""
    if not pose.place:
        return np.full(len(pose.actual), np.nan)
    distance: Array = np.linalg.norm((pose.actual - pose.reference)[:, : pose.place], axis=1)
    return distance


def rotation_errors(pose: Poses) -> Array:
    """Angle by which the end effector is turned from its reference, in [0, pi] [rad], shape (N,).

    In a plane the difference of phi, in space the angle of the rotation from one to the other; NaN
    where no rotation is a part of the pose.
    """
    if pose.place == len('xy') and pose.actual.shape[1] > pose.place:
        apart = pose.actual[:, pose.place] - pose.reference[:, pose.place]
        return np.abs(np.remainder(apart + math.pi, 2.0 * math.pi) - math.pi)
    return angles_between(pose.actual, pose.reference, pose.rotation_components)


def smooth_over(time: Array) -> int:
    """Samples on each side of a moving mean over SMOOTH; `time` of samples [s], shape (N,)."""
    return samples_beside(float(np.median(np.diff(time)))) if len(time) > 1 else 1


def samples_beside(period: float) -> int:
    """The same by the period [s]; 0 where it is too long for a chattering."""
    return round(0.5 * SMOOTH / period)


def high_pass(torque: Array, half: int) -> Array:
    """Torques minus their moving mean over so many samples on each side, shape (N, n).

    NaN without a sample on each side: what changes between the samples is not known then.
    """
    if not half:
        return np.full_like(torque, math.nan)
    longer = np.pad(torque, ((half, half), (0, 0)), mode='edge')
    total = np.zeros_like(torque)
    for k in range(2 * half + 1):  # not by np.convolve, whose last bits are the processor's
        total += longer[k : k + len(torque)]
    return torque - total / (2 * half + 1)
