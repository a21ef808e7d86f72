"""From recorded joints and torques to the rows of a linear regression, without phase errors.

Positions are smoothed and differentiated by local polynomials (Savitzky-Golay), the same to both
sides in time. Then one low-pass filter is applied to both sides of Y beta = tau, which are then
decimated to its bandwidth, so that noise beyond it is lost and what is left is hardly correlated.

Source:
    Gautier (1997), Dynamic identification of robots with power model, ICRA: parallel decimation;
    Swevers, Verdonck, De Schutter (2007), Dynamic model identification for industrial robots, IEEE
    Control Systems 27(5).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import firwin, savgol_filter

from parallel_robot.studies.identification import base_parameters
from parallel_robot.studies.identification.base_parameters import (
    ALWAYS,
    BaseParameters,
    FrictionColumn,
)
from parallel_robot.studies.identification.measured_motion import (
    STILL,
    MeasuredMotion,
    RunMotion,
    joined,
    rows_of,
    stretches,
)
from parallel_robot_model.common.errors import BagError, InputError, KinematicsError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

CUTOFF = 10.0  # Hz
WINDOW = 0.4  # of 1 / cutoff, the window of the polynomials, which pass frequencies 4 times higher
DEGREE = 4  # of the polynomials
SUPPORT = 3.3  # of 1 / cutoff, the length of the low-pass filter
SLOW = 0.02  # of its rms, the speed below which the sign of a joint's rate is in doubt
DOUBT = 0.2  # share of such time above which a row says nothing of friction
FEWEST = 4  # rows for each parameter
ROUNDING = 1e-3  # relative, of the highest cut-off frequency: stamps are not exact
RATIO = 10.0  # samples in a period of the cut-off frequency
SOME = 10_000  # rows that are kept of any number
BLOCK = 200  # rows that are made at once: the samples of a stretch have a regressor each


@dataclass(frozen=True)
class Rows:
    """Y beta = tau at T times of a stretch without gaps, filtered."""

    time: Array  # times [s], shape (T,)
    # regressor of base parameters and friction, shape (T, n, B + F); zero where `known` is not
    Y: Array
    torque: Array  # torques [N m], shape (T, n); zero where `known` is not
    # whether the torque of a joint can be explained: it does not stand still
    known: NDArray[np.bool_]

    @property
    def duration(self) -> float:
        """Time that the rows represent [s]."""
        if len(self.time) < 2:
            return 0.0
        return float(np.median(np.diff(self.time)) * len(self.time))

    def first(self, parameters: int) -> Rows:
        """The same without the parameters after so many."""
        return replace(self, Y=self.Y[..., :parameters])


class SomeRows:
    """Rows evenly of all, at most SOME: enough to draw them."""

    def __init__(self) -> None:
        self._parts: list[Rows] = []
        self._every, self._count, self._kept = 1, 0, 0

    def seen(self, parts: Iterable[Rows]) -> Iterator[Rows]:
        """The same parts, which are looked at as they pass."""
        for part in parts:
            yield part
            chosen = rows_of(part, slice(-self._count % self._every, None, self._every))
            self._parts.append(joined([chosen]))  # a copy, or all of the part stays
            self._count, self._kept = self._count + len(part.time), self._kept + len(chosen.time)
            while self._kept > SOME:
                self._parts = [rows_of(self.whole(), slice(None, None, 2))]
                self._every, self._kept = 2 * self._every, len(self._parts[0].time)

    def whole(self) -> Rows:
        """What was kept."""
        return joined(self._parts)


class At(NamedTuple):
    """Where what is not linear is taken."""

    late: float = 0.0  # age of the positions at their stamps, beyond that of the torques [s]
    # all parameters, for what gears transmit and for the Stribeck effect, shape (B + F,)
    values: Array | None = None


NOWHERE = At()


def rows(
    motion: RunMotion,
    robot: RobotModel,
    base: BaseParameters,
    guess: Array,
    smoothing: float,
    cutoff: float = CUTOFF,
    at: At = NOWHERE,
    step: float = 0.0,
) -> Iterator[Rows]:
    """Make the rows of a recording, stretch by stretch.

    Args:
        motion: Joints and torques.
        robot: The robot, of whose parameters the geometry alone counts.
        base: Its base parameters.
        guess: Pose near the first sample, shape (m,).
        smoothing: Half width of the sign of Coulomb friction [rad/s].
        cutoff: Bandwidth [Hz].
        at: Where what is not linear is taken. With the values of a Stribeck effect, the slope of
            the torques by the logarithm of its speed is one more column of Y.
        step: Difference of the age by which the torques are differentiated [s]: their slope, for
            a period of age, is one more column of Y, the last; 0: none.

    Raises:
        InputError: the cut-off frequency does not fit the period.
        BagError: too little of the recording can be used, or a sample has no pose.
    """
    period, highest = motion.period, highest_cutoff(motion)
    if not 0.0 < cutoff <= (1.0 + ROUNDING) * highest:
        raise InputError(
            f'--cutoff must be positive and at most {highest:g} Hz for samples every '
            f'{period:g} s, not {cutoff:g}'
        )
    slow = np.maximum(SLOW * motion.speed, STILL)
    window = 2 * max(3, round(0.5 * WINDOW / cutoff / period)) + 1
    taps = 2 * round(0.5 * SUPPORT / cutoff / period) + 1
    every = max(1, round(0.5 / cutoff / period))
    duration, known, model = 0.0, 0, base_parameters.linear_model(robot)
    for part in stretches(motion, 2 * (window + taps)):
        ages = (at.late, at.late + step) if step else (at.late,)
        try:
            smooth = _smoothed(part, period, window, ages)
            pose = poses_of(robot, smooth.position, guess, any_mode=True)
        except KinematicsError as error:
            raise BagError(str(error)) from None
        guess = pose[-1]
        rates = -np.diff(smooth.torque, axis=2) / step * period if step else smooth.torque[..., 1:]
        pieces = []
        for first in range(0, len(pose) - taps + 1, BLOCK * every):
            some = slice(first, first + (BLOCK - 1) * every + taps)
            piece = rows_of(smooth, some)
            moved = piece.position, piece.velocity, piece.acceleration
            inertia = model.regressor(robot.parameters, pose[some], *moved)[..., list(base.kept)]
            friction = _friction(piece, inertia, base, at.values, smoothing, period)
            Y = np.concatenate([inertia, friction, rates[some]], axis=-1)
            pieces.append(_filtered(piece, Y, slow, taps, every, cutoff, period))
        found = joined(pieces)
        yield found
        duration, known = duration + found.duration, known + int(found.known.sum())
    needed = FEWEST * (len(base.inertias) + ALWAYS * base.joints)
    if known < needed:
        why = ''.join(f'; {line}' for line in motion.left_out)
        told = f'{duration:.3g} s of {motion.duration:.3g} s{why}'
        rows = f'{known} torques of joints that move, {needed} are needed'
        raise BagError(
            f'too little motion to identify a robot: {told}; {rows} (--cutoff {cutoff:.3g})'
        )


def highest_cutoff(motion: RunMotion) -> float:
    """Highest bandwidth for the rate of a recording [Hz]."""
    return 1.0 / (RATIO * motion.period)


def base_of(motion: RunMotion, robot: RobotModel, guess: Array) -> BaseParameters:
    """Base parameters of a robot at the positions of a recording; `guess` as in :func:`rows`.

    Raises:
        BagError: a sample has no pose.
    """
    positions = (window.position[window.usable] for window in motion.windows())
    try:
        return base_parameters.find(robot, positions, motion.count, guess)
    except KinematicsError as error:
        raise BagError(str(error)) from None


@dataclass(frozen=True)
class _Smooth:
    """Motion of a stretch on a regular grid: time (N,), torque (N, n, A), the others (N, n)."""

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    torque: Array


def _smoothed(
    part: MeasuredMotion, period: float, window: int, ages: tuple[float, ...]
) -> _Smooth:
    """Joints with two derivatives, and the mean torque over one period about each sample.

    The effort of a state acted before it, that of the next one after it: their mean belongs to
    the state. In general it is the difference of the integral of the effort. A late position
    belongs to the torque of the time at which it was measured: A torques for A ages.
    """
    stamps, effort = part.time, part.effort
    steps = np.diff(stamps)
    time, position = stamps, part.position
    if np.abs(steps - period).max() > 1e-3 * period:  # jitter, or a lost state
        count = int((stamps[-1] - stamps[0]) / period) + 1
        time = stamps[0] + period * np.arange(count)
        position = CubicSpline(stamps, position)(time)
    impulse = np.zeros_like(effort)
    np.cumsum(effort[1:] * steps[:, np.newaxis], axis=0, out=impulse[1:])
    torque = np.empty((*position.shape, len(ages)))
    for k, age in enumerate(ages):
        middle = time - age
        for joint, row in enumerate(impulse.T):
            after, before = (
                np.interp(middle + side * period, stamps, row) for side in (0.5, -0.5)
            )
            torque[:, joint, k] = (after - before) / period
    inner = slice(window // 2 + 1, -(window // 2) - 1)
    fits = (
        savgol_filter(position, window, DEGREE, deriv, period, axis=0)[inner] for deriv in range(3)
    )
    smooth, velocity, acceleration = fits
    return _Smooth(time[inner], smooth, velocity, acceleration, torque[inner])


def _friction(
    smooth: _Smooth,
    inertia: Array,
    base: BaseParameters,
    values: Array | None,
    smoothing: float,
    period: float,
) -> Array:
    """Columns of friction, and of the speed of its Stribeck effect, shape (N, n, F or F + 1).

    The sign is its mean over one period, within which the rate may pass zero.
    """
    rate = smooth.velocity
    width = np.maximum(smoothing, 0.5 * period * np.abs(smooth.acceleration))
    sign = np.clip(rate / np.maximum(width, 1e-12), -1.0, 1.0)
    B = inertia.shape[2]
    transmitted = np.zeros_like(rate) if values is None else inertia @ values[:B]

    def column(each: FrictionColumn) -> Array:
        v, s = rate[:, each.joint], sign[:, each.joint]
        if each.kind == 'stribeck':
            return np.asarray(s * np.exp(-((v / each.speed) ** 2)))
        by_load = np.abs(transmitted[:, each.joint]) * s
        plain = {'viscous': v, 'coulomb': s, 'offset': np.ones_like(v), 'load': by_load}
        return plain[each.kind]

    columns = base.friction
    fast = values is not None and any(each.kind == 'stribeck' for each in columns)
    out = np.zeros((*rate.shape, len(columns) + fast))
    for k, each in enumerate(columns):
        out[:, each.joint, k] = found = column(each)
        if fast and values is not None and each.kind == 'stribeck':
            share = rate[:, each.joint] / each.speed
            out[:, each.joint, -1] = values[B + k] * found * 2.0 * share**2
    return out


def _filtered(
    smooth: _Smooth,
    Y: Array,
    slow: Array,
    taps: int,
    every: int,
    cutoff: float,
    period: float,
) -> Rows:
    """Both sides through the low-pass filter, decimated."""
    low_pass = firwin(taps, cutoff, fs=1.0 / period)

    def through(values: Array, shape: Array = low_pass) -> Array:
        return np.asarray(sliding_window_view(values, taps, axis=0)[::every] @ shape)

    share = np.abs(low_pass) / np.abs(low_pass).sum()
    known = through((np.abs(smooth.velocity) < slow).astype(float), share) < DOUBT
    return Rows(
        smooth.time[taps // 2 : len(smooth.time) - taps // 2 : every],
        through(Y) * known[..., np.newaxis],
        through(smooth.torque[..., 0]) * known,
        known,
    )
