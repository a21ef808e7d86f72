"""The lag of the motors: a time constant between commands and measured efforts.

Efforts are means over a period of what follows the commands, whole samples late, by a first order

    dx/dt = (u - x) / T,  effort = mean of x,

whose T has the least squares, joint by joint. Its interval is that of the linear model about it,
with the correlation of what is left from sample to sample.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from parallel_robot.bags.run import two_sources
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.studies.identification.measured_motion import GAP, LONGEST, SPAN, STILL
from parallel_robot_model.common.tables import Part, ShownResult
from parallel_robot_model.common.units import HINGES, Array, JointUnits, rounded

LONGEST_LAG = 0.05  # s that is looked for
WARM = 5.0  # of it, after which what was before the first command is forgotten
LATEST = 20  # samples, the longest delay that is looked for
FEWEST = 200  # samples that can be used
TRIED = 30  # time constants of each delay
SHOWN = 0.05  # of a period, the least lag that is told
UNLIKE = 0.5  # of the squares of efforts: more is left where they do not follow the commands


@dataclass(frozen=True, repr=False)
class MotorLag(ShownResult):
    """How efforts follow commands."""

    values: Array  # time constants [s], shape (n,)
    half_widths: Array  # half widths of their 95 % intervals [s], shape (n,)
    delay: float  # of the commands before that, from the stamp of the state that they answer [s]
    period: float  # of the samples [s]

    @property
    def found(self) -> bool:
        """Whether a joint has a lag that its interval tells from none."""
        least = np.maximum(self.half_widths, SHOWN * self.period)
        return bool((self.values > least).any())

    def parts(self) -> list[Part]:
        """The time constants, and as a scenario takes them."""
        late = f', {1e3 * self.delay:.3g} ms late' if self.delay else ''
        if not self.found:
            return [f'efforts follow the commands without a lag{late}']
        pairs = zip(self.values, self.half_widths, strict=True)
        each = ', '.join(f'{1e3 * value:.4g} +- {1e3 * half:.2g}' for value, half in pairs)
        return [
            f'lag of the motors: {each} ms{late}; for a scenario',
            f'  estimator.lag: {float(self.values.mean()):.3g}',
        ]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            'estimates_s': self.values.tolist(),
            'half_widths_95_s': self.half_widths.tolist(),
            'delay_s': self.delay,
            'found': self.found,
        }


class LongestStretch:
    """The longest stretch of a run without a gap, of whose begin the lag is found."""

    def __init__(self, period: float) -> None:
        """Begin without states; `period` is the time between two [s]."""
        self._period = period
        self._last: tuple[float, bool] | None = None  # time of the last state; whether it is known
        # commands and efforts of the stretch that goes on and of the longest one, (N, 2, n)
        self._now = self._kept = np.zeros((0, 2, 0))
        self._length = self._longest = 0

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        if not log.has_efforts or len(log.answer) != len(log.time) or not len(log.time):
            return
        known = np.isfinite(log.answer).all(axis=1) & np.isfinite(log.effort).all(axis=1)
        time, before = self._last or (np.nan, False)
        steps = np.diff(log.time, prepend=time)
        known_before = np.append(before, known[:-1])
        broken = ~known | ~known_before | ~(np.abs(steps - self._period) <= 1e-3 * self._period)
        self._last = float(log.time[-1]), bool(known[-1])
        bounds = np.unique([0, *np.flatnonzero(broken), len(broken)])
        longest = int(np.argmax(np.diff(bounds)))
        both = np.stack([log.answer, log.effort], axis=1)
        for k in sorted({0, longest, len(bounds) - 2}):  # others are neither longer nor go on
            begin, end = bounds[k : k + 2].tolist()
            if broken[begin]:
                self._length, self._now = 0, both[:0]
            if self._length < LONGEST:
                self._now = np.concatenate([self._now, both[begin:end]])[:LONGEST]
            self._length += end - begin
            if self._length > self._longest:
                self._longest, self._kept = self._length, self._now

    def lag(self) -> MotorLag | None:
        """The lag in what was taken; None without commands, measured efforts or enough of both."""
        period = self._period
        if not self._longest or period <= 0.0:
            return None
        command, effort = self._kept.swapaxes(0, 1).copy()
        warm = round(WARM * LONGEST_LAG / period) + LATEST
        if len(command) < warm + FEWEST or not np.ptp(command[warm:], axis=0).all():
            return None
        known = two_sources.ratio(effort[1:], command[:-1], period)
        for joint, factor in known.clear().items() if known else ():
            if abs(factor - 1.0) > two_sources.NEAR:  # as of motors that give less
                command[:, joint] *= factor
        tried = np.append(0.0, np.geomspace(SHOWN * period, LONGEST_LAG, TRIED - 1))
        joints = [_Joint(*each, period, warm) for each in zip(command.T, effort.T, strict=True)]
        off = np.array([[joint.squares(lag) for lag in tried] for joint in joints])
        delay = int(off.min(axis=1).sum(axis=0).argmin())
        found = [
            joint.nearest(tried, of_joint, delay)
            for of_joint, joint in zip(off[..., delay], joints, strict=True)
        ]
        if (off.min(axis=(1, 2)) > UNLIKE * np.sum(effort**2, axis=0)).any():
            return None  # efforts do not follow the commands
        values, half_widths = np.array(found).T
        return MotorLag(values, half_widths, delay * period, period)


class _Joint(NamedTuple):
    """Commands and efforts of a joint."""

    command: Array  # [N m], shape (N,)
    effort: Array  # [N m], shape (N,)
    period: float  # of the samples [s]
    warm: int  # samples after which what was before the first command is forgotten

    def followed(self, lag: float) -> Array:
        """Means over the periods from each command on of a lag behind them [N m], shape (N,)."""
        command = self.command
        kept = np.exp(-self.period / lag) if lag > 0.0 else 0.0
        begin = command[0] + lfilter([0.0, 1.0 - kept], [1.0, -kept], command - command[0])
        return np.asarray(command + (begin - command) * (1.0 - kept) * lag / self.period)

    def left(self, followed: Array, delay: int) -> Array:
        """Efforts less what follows commands that act so many samples late [N m]."""
        late = followed[: len(followed) - 1 - delay]
        return np.asarray((self.effort[1 + delay :] - late)[self.warm :])

    def squares(self, lag: float) -> list[float]:
        """Sums of the squares of what a lag leaves, by the delay."""
        followed = self.followed(lag)
        return [float(np.sum(self.left(followed, delay) ** 2)) for delay in range(LATEST + 1)]

    def nearest(self, tried: Array, squares: Array, delay: int) -> tuple[float, float]:
        """Time constant with the least squares, and half width of its 95 % interval [s]."""
        best = int(squares.argmin())
        around = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]

        def left(lag: float) -> Array:
            return self.left(self.followed(lag), delay)

        near = minimize_scalar(
            lambda lag: np.sum(left(lag) ** 2), bounds=around, method='bounded',
            options={'xatol': 1e-9 * LONGEST_LAG},
        )  # fmt: skip
        value = float(near.x)
        step = 1e-3 * max(value, SHOWN * self.period)
        slope, rest = (left(value + step) - left(value)) / step, left(value)
        size = float(np.sum(slope**2))
        error = np.sqrt(np.sum(rest**2) / (len(rest) - 1) / size) if size else np.inf
        parts = rest * slope
        alike = np.clip(np.sum(parts[1:] * parts[:-1]) / max(np.sum(parts**2), 1e-300), 0.0, 0.99)
        return value, 1.96 * float(error * np.sqrt((1.0 + alike) / (1.0 - alike)))


# Noise of the sensors, from phases of a recording in which the robot rests.
#
# Noise is told from what still moves by third differences, in which a smooth motion vanishes and
# white noise has 20 times its variance.
#
# Source:
#     Hall, Kay, Titterington (1990), Asymptotically optimal difference-based estimation of
#     variance in nonparametric regression, Biometrika 77(3).

SHORTEST = 0.1  # s of a phase
NO_REST = f'sensor noise: the bag has no phase of rest of {SHORTEST:g} s'
ORDER, GAIN = 3, 20.0  # of the differences; variance of that of white noise, in parts of its own


@dataclass(frozen=True, repr=False)
class Rest(ShownResult):
    """Noise of the measured joints at rest, rms."""

    duration: float  # length of all phases [s]
    position: Array  # [rad], shape (n,)
    velocity: Array  # [rad/s], shape (n,); NaN where it was not measured
    units: JointUnits = HINGES  # units of the joints

    def parameters(self) -> dict[str, list[float]]:
        """Parameters of the estimator that follow, by key; none where there is no noise."""
        both = {'position_noise': self.position, 'velocity_noise': self.velocity}
        return {key: rounded(values, 3) for key, values in both.items() if np.all(values > 0.0)}

    def parts(self) -> list[Part]:
        """The parameters as a scenario takes them."""
        if not self.parameters():
            return [f'no sensor noise in {self.duration:.3g} s at rest']
        head = f'sensor noise in {self.duration:.3g} s at rest, rms, for a scenario'
        found = [f'  estimator.{key}: {values}' for key, values in self.parameters().items()]
        return [head, *found]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        unknown = np.isnan(self.velocity).any()
        noise = {
            'duration_s': self.duration,
            self.units.key('position_noise_rad'): self.position.tolist(),
            self.units.key('velocity_noise_rad_s'): None if unknown else self.velocity.tolist(),
        }
        return {'rest': noise}


def rest_of(log: RunLog) -> Rest | None:
    """Noise of a run at rest; None if it has no phase of rest.

    At rest, neither the reference nor the robot moves.
    """
    steps = np.diff(log.time)
    still = Resting(float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0)
    still.add(log)
    return still.rest()


class Resting:
    """Noise in the phases of rest of a run, window by window.

    Phases are cut after each LONGEST states, whatever the windows are.
    """

    def __init__(self, period: float) -> None:
        """Begin without states; `period` is the time between two [s]."""
        self._period = period
        self._left: list[list[Array]] = []  # states that are not looked at, as :meth:`_take`
        self._rows = self._differences = 0
        self._squares: Array | float = 0.0
        self._units = HINGES

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        self._units = log.units
        self._left.append([log.time, log.position, log.velocity, log.reference_velocity])
        states = [np.concatenate(each) for each in zip(*self._left, strict=True)]
        last = len(states[0]) - len(states[0]) % LONGEST
        for begin in range(0, last, LONGEST):
            self._take(*(each[begin : begin + LONGEST] for each in states))
        self._left = [[each[last:] for each in states]]

    def rest(self) -> Rest | None:
        """The noise in what was taken; None if it has no phase of rest."""
        for states in self._left:
            self._take(*states)
        self._left = []
        if not self._rows:
            return None
        position, velocity = np.sqrt(self._squares / self._differences / GAIN)
        return Rest(self._rows * self._period, position, velocity, self._units)

    def _take(
        self, time: Array, position: Array, velocity: Array, reference_velocity: Array
    ) -> None:
        period = self._period
        count = max(round(SHORTEST / period), 2 * ORDER) if period else 0
        if not count or len(time) <= count:
            return
        steps = np.diff(time)
        commanded = np.abs(np.nan_to_num(reference_velocity)).max(axis=1) > STILL
        span = max(1, round(SPAN / period))
        moved = np.abs(position[span:] - position[:-span]).max(axis=1) > STILL * SPAN
        moving = commanded.copy()
        for k in (0, span):  # both ends of a way
            moving[k : k + len(moved)] |= moved
        broken = (steps <= 0.0) | (steps > GAP * period)
        edges = np.flatnonzero(np.diff(moving.astype(int)) != 0) + 1
        bounds = np.unique([0, len(time), *edges, *(np.flatnonzero(broken) + 1)])
        for first, stop in itertools.pairwise(bounds.tolist()):
            if stop - first < count or moving[first]:
                continue
            self._rows += stop - first
            self._differences += stop - first - ORDER
            both = np.stack([position[first:stop], velocity[first:stop]])
            self._squares = self._squares + (np.diff(both, ORDER, axis=1) ** 2).sum(axis=1)
