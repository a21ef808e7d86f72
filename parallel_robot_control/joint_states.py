"""Joint states that a controller gets: which it refuses, how often they come, what is wrong."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.safety import faults
from parallel_robot_model.common.units import NANOSECONDS, Array, usual_period

# What is wrong with the joint states that a controller hears, in lines for its user.

AHEAD = NANOSECONDS // 1000  # ns, by which clocks that are synchronised may differ
SYNCHRONISE = 'synchronise the clocks (PTP, chrony)'


def of_clock(ahead: int) -> str:
    """That stamps lie ahead of the clock by some time [ns]; empty if they do not."""
    if ahead <= AHEAD:
        return ''
    seconds = ahead / NANOSECONDS
    return f'joint states are stamped {seconds:.3g} s ahead: cannot be latency; {SYNCHRONISE}'


def of_age(age: int, limit: float) -> str:
    """That states are refused because they are too old.

    Args:
        age: How old they are when they come [ns].
        limit: How old they may be [s].
    """
    return (
        f'joint states are {age / NANOSECONDS:.3g} s old when they come and refused '
        f'(safety.state_age {limit:g} s): {SYNCHRONISE}, or find what holds them up'
    )


def _of_numbers(problem: str, joints: tuple[str, ...]) -> str:
    """That states are refused because numbers are missing."""
    what = f'joint states are refused: {problem}'
    if problem.startswith('velocity'):
        way = 'estimator.kind filter or levant, or kalman with estimator.velocities false'
        return f'{what}; {way}, needs positions alone'
    return f'{what}; wanted are those of {", ".join(joints)}'


# Joint states that a controller does not answer: by which clocks, and what was wrong lately.

LATELY = 0.2  # s, since a state was refused, in which that is reported


class RefusedStates:
    """Judges stamps by the clocks of this machine, and keeps why a state was refused last."""

    def __init__(self, limit: float, ros_time: Callable[[], int]) -> None:
        """Begin with none.

        Args:
            limit: How old a state may be, and how far its stamp may be ahead [s].
            ros_time: Gives the time of ROS, perhaps a simulated one [ns].
        """
        self._limit, self._ros_time = limit, ros_time
        self._clock_offset = time.time_ns() - time.monotonic_ns()
        self._last, self._noted_at = (faults.NONE, 0), -math.inf
        self.count = 0  # of states that were refused

    def now(self) -> int:
        """Time against which the age of a state is checked [ns].

        The earlier of two clocks: stamps go on as before when the system clock is set.
        """
        return min(time.time_ns(), self._clock_offset + time.monotonic_ns())

    def refusal(self, stamp: int) -> int:
        """Why a state with this stamp [ns] is refused: it waited in a queue, or is ahead."""
        clocks, limit = self._clocks(), round(self._limit * NANOSECONDS)
        if min(clocks) - stamp > limit:
            return self.note(faults.STATES_LATE, min(clocks) - stamp)
        if max(clocks) - stamp < -limit:
            return self.note(faults.STATES_AHEAD, stamp - max(clocks))
        return faults.NONE

    def note(self, wrong: int, difference: int = 0) -> int:
        """Note why a state is refused, and by how much its stamp is wrong [ns]."""
        self._last, self._noted_at = (wrong, difference), time.monotonic()
        self.count += 1
        return wrong

    def warnings(self, stamp: int, problem: str, joints: tuple[str, ...]) -> dict[str, str]:
        """What is wrong with the states, for people; see SuiteNode.warnings.

        Args:
            stamp: Stamp of the state that was answered last [ns].
            problem: What was wrong with the last message that was not understood.
            joints: Names of the joints.
        """
        lines, ahead = {}, stamp - max(self._clocks())
        if time.monotonic() - self._noted_at < LATELY:
            wrong, difference = self._last
            if wrong == faults.STATES_AHEAD:
                ahead = difference
            elif wrong == faults.STATES_LATE:
                lines['age'] = of_age(difference, self._limit)
            else:
                lines['numbers'] = _of_numbers(problem, joints)
        return lines | {'ahead': of_clock(ahead)}

    def _clocks(self) -> tuple[int, int, int]:
        """Present times that a stamp may be of [ns]."""
        return time.time_ns(), self._clock_offset + time.monotonic_ns(), self._ros_time()


# How often joint states come, and how many of them were not answered, by their stamps.

FEW = 10  # steps from a state to the next, below which nothing is said
NEAR = 0.1  # share of the period, by which steps may differ from it on average
SINGLE = 0.02  # share of steps of one period, at least, of states of that period
PAUSE = NANOSECONDS // 2  # ns; a longer step is one to another run


class StateRhythm:
    """Finds the period of the states that were answered, and how many are missing between them."""

    def __init__(self, period: int) -> None:
        """Prepare; `period` is that of the configuration [ns]."""
        # from a state to the next [ns]: that of the configuration while it fits
        self.period = self._expected = period
        self.skipped = 0  # number of states that were not answered, or never arrived
        # of what was looked at last: the same, how many were due, the longest step [ns]
        self.last = 0, 0, 0
        self._noted: deque[NDArray[np.int64]] = deque()
        self._stamps = np.zeros(0, np.int64)

    def note(self, stamps: NDArray[np.int64]) -> None:
        """Note the stamps of answered states [ns], zero for none; cheap, for the loop."""
        self._noted.append(stamps)

    def look(self) -> None:
        """Take in what was noted since the last time; in one thread alone."""
        new = [self._noted.popleft() for _ in range(len(self._noted))]
        self.last = 0, 0, 0
        stamps = np.concatenate([self._stamps, *(part[part > 0] for part in new)])
        if len(stamps) <= FEW:
            self._stamps = stamps
            return
        self._stamps = stamps[-1:]
        steps = np.diff(stamps)
        steps = steps[(steps > 0) & (steps < PAUSE)]
        if not len(steps):
            return
        periods = _periods(steps, self._expected)
        near = abs(steps.sum() / (periods.sum() * self._expected) - 1.0) < NEAR
        fits = near and np.mean(periods == 1) > SINGLE
        self.period = self._expected if fits else usual_period(steps)
        # Each by itself counts steps that are long by chance, all together a period that is.
        due = min(_periods(steps, self.period).sum(), round(steps.sum() / self.period))
        missing = max(0, int(due) - len(steps))
        self.skipped += missing
        self.last = missing, missing + len(steps), int(steps.max())

    @property
    def warning(self) -> str:
        """That the period of the configuration is another one; empty if it fits."""
        if self.period == self._expected:
            return ''
        found, expected = (NANOSECONDS / each for each in (self.period, self._expected))
        return (
            f'joint states come at {found:.4g} Hz, the period says {expected:.4g} Hz: '
            f'give the controller the period {self.period / NANOSECONDS:.4g}'
        )


# Whether commands act at a rate of their own, by the efforts of the states that were answered.

MOST = 0.7  # share of the steps of efforts that have the same number of states between them


class HeldCommands:
    """Finds that efforts change with each second, say, state alone, and commands with each."""

    def __init__(self) -> None:
        """Begin with none."""
        self.warning = ''  # that they do; empty if not
        self._noted: deque[tuple[Array, Array]] = deque()

    def note(self, efforts: Array, commands: Array) -> None:
        """Note efforts [N m] and what answered them, shape (N, n) each; cheap, for the loop."""
        self._noted.append((efforts, commands))

    def look(self) -> None:
        """Take in what was noted since the last time; in one thread alone."""
        new = [self._noted.popleft() for _ in range(len(self._noted))]
        self.warning = ''
        if not new:
            return
        applied, commanded = (
            (np.diff(np.concatenate(rows), axis=0) != 0.0).any(axis=1)
            for rows in zip(*new, strict=True)
        )
        spans = np.diff(np.flatnonzero(applied))
        if len(spans) <= FEW or commanded.mean() < MOST:
            return
        usual = int(np.median(spans))
        if usual > 1 and np.mean(spans == usual) > MOST:
            self.warning = (
                f'efforts change with 1 of {usual} states, commands with each: has the effort '
                'controller an update_rate of its own? (docs/hardware.md)'
            )


# States that are missing, reported with their likely cause.

HELD = 0.1  # share of the states, from which on real time is not held
MISSING = 0.02  # share of the states, from which on they are reported missing
UNTOLD = 10.0  # s without that, after which it is reported anew
BROADCASTER = (
    'ros2_control_node needs chrt -f 25, else its publishing thread has normal priority '
    '(docs/hardware.md)'
)
HELD_UP = 'this node or the network was held up (docs/real_time.md)'


def of_missing(missing: int, due: int, longest: int, sent: bool) -> str:
    """That states are missing, and why that may be.

    Args:
        missing: How many.
        due: Of how many.
        longest: The longest step from a state to the next [ns].
        sent: Whether they are known to have been sent.
    """
    what, cause = ('sent in vain', HELD_UP) if sent else ('never sent', BROADCASTER)
    gap = 1e3 * longest / NANOSECONDS
    return f'joint states: {100 * missing / due:.2g} % {what}, gap up to {gap:.3g} ms: {cause}'


class MissingStates:
    """Which states were missing within the last second, by their stamps; whether to report it.

    Those that were sent the middleware numbers: they came too late to be answered, or not at all.
    """

    def __init__(self, gap: float) -> None:
        """Begin with none; `gap`: a step after which the law begins anew [s]."""
        self._gap = round(gap * NANOSECONDS)
        self._taken = 0  # states that were lost or refused until the last look
        self.figures = ''  # share and longest gap of the last second
        self.never_sent, self._never_sent_at = '', -math.inf
        self.sent = ''  # that as many were sent in vain that real time is not held

    def look(self, last: tuple[int, int, int], taken: int, late: float) -> None:
        """Take in what was found.

        Args:
            last: StateRhythm.last.
            taken: States that were lost on their way, or refused, since the start.
            late: Largest age of a state when it was answered [s].
        """
        (missing, due, longest), now = last, time.monotonic()
        unapplied, self._taken = min(missing, taken - self._taken), taken
        share = 100 * missing / max(due, 1)
        self.figures = f'{share:.2g} %, longest gap {1e3 * longest / NANOSECONDS:.3g} ms'
        unsent, self.sent = missing - unapplied, ''
        if unsent > MISSING * due or (longest > self._gap and unsent > unapplied):
            self.never_sent = of_missing(unsent, due, longest, False)
            if late * NANOSECONDS > self._gap:
                self.never_sent += f'; others come up to {1e3 * late:.3g} ms late'
            self._never_sent_at = now
        elif now - self._never_sent_at > UNTOLD:
            self.never_sent = ''
        if unapplied > HELD * due:
            self.sent = of_missing(unapplied, due, longest, True)


def _periods(steps: NDArray[np.int64], period: int) -> Array:
    """Number of periods of each step."""
    return np.maximum(np.rint(steps / period), 1.0)
