"""One state message in, one command message out: everything in between, compiled.

What a controller keeps from one state to the next is in the core of its law: see law_core.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import When, before_cycle
from parallel_robot_control.estimation import lock_in
from parallel_robot_control.estimation.estimator import KALMAN
from parallel_robot_control.joint_states import HeldCommands, StateRhythm
from parallel_robot_control.messages import (
    NOT_UNDERSTOOD,
    answers_message,
    joint_row,
    open_message,
)
from parallel_robot_control.reference_buffer import (
    MISSING,
    RESTART,
    TOO_OLD,
    moved_on,
    reference_at,
)
from parallel_robot_control.safety import faults, limiting
from parallel_robot_control.safety.limiting import OVERDUE, QUIET
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import inner, is_finite, kernel, read_row, select, write_row
from parallel_robot_model.configuration.loop import OLDEST
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import SLOW

# The arrays shared by the controller and its kernels: Python reads them between two calls.

NEVER = -1  # a stamp that no message has
FOREVER = 2**63 - 1  # ns
AGES = 4096  # answers for which the age of the state is kept

# Rows of Shared.telemetry
ERROR, ERROR_RATE, COUPLED, SLIDING = range(4)
# and of Shared.numbers.
(
    ACTED,  # bits of the limits that acted
    LAST, FROM, START, END,  # stamps: last answer, first to answer, start and end of the motion
    HEARD,  # time of the last answer on the monotonic clock; 0: none, or the end
    LOGGED, ANSWERS,  # counts: rows of the log, answers
    AGE,  # of the last state, from the measurement until the torque acts [ns]
    PHASE,  # of the identification of the delay, see lock_in.py
    CAUSE,  # fault whose cause was there at the last state
    ACTED_AT,  # stamp of the last state at which a limit acted
    UNTIL,  # stamp of the newest reference that counts
    WAITS,  # whether the last reference was overdue
    CAME,  # when the last state came, on the clock of the stamps [ns]
    YOUNGEST,  # about the least age that states have when they are answered [ns]
) = range(16)  # fmt: skip
QUEUED = 1  # periods by which a state of a burst is older than others: a younger one is behind it
AGEING = 250  # states after which the least age counts as a period larger


class Shared(NamedTuple):
    """The arrays that Python and the kernels share."""

    measured: Array  # position, velocity and effort of the last state, shape (3, n)
    telemetry: Array  # telemetry of the last answer, one row a vector, shape (4, n)
    numbers: NDArray[np.int64]  # limits, stamps and counts, shape (16,)
    command: NDArray[np.uint8]  # the command message of the last answer, serialised
    torques: Array  # the torques in it [N m], shape (n,)
    # stamps of state and reference of each answer, and when its torque acts [ns], shape
    # (AGES, 3)
    log: NDArray[np.int64]
    commanded: Array  # torques of each answer in the log [N m], shape (AGES, n)
    efforts: Array  # measured efforts of the states in the log [N m], shape (AGES, n)
    ages: NDArray[np.int64]  # ages of the states when they were answered [ns], shape (AGES,)


def shared(joints: int) -> Shared:
    """Arrays before the first state."""
    command = layouts.float64_multi_array(joints).draft()
    made = Shared(
        np.zeros((3, joints)),
        np.zeros((4, joints)),
        np.zeros(16, np.int64),
        command.bytes,
        command.fields['data'],
        np.zeros((AGES, 3), np.int64),
        np.zeros((AGES, joints)),
        np.zeros((AGES, joints)),
        np.zeros(AGES, np.int64),
    )
    made.numbers[[LAST, START, END, CAME]] = NEVER
    made.numbers[[UNTIL, YOUNGEST]] = FOREVER, FOREVER // 2
    return made


# Return value of answer: bits, if the state was answered ...
ANSWERED = 1
STATUS = 2  # a new fault or limit
TELEMETRY = 4  # the slow topics are due at this sample
LOG = 8  # the log of the answers is due at this sample
# ... or the reason why it was not.
UNKNOWN = -1  # another layout, or numbers that are not finite
NO_REFERENCE = -2
OUT_OF_ORDER = -3  # the stamp repeats, goes back or jumps
OLD = -4  # the state is too old
STALE = -5  # no state was answered for too long: the controller itself was stalled
EARLY = -6  # the state is from before the start
AHEAD = -7  # its stamp is ahead of the clock
OVERTAKEN = -10  # it is one of many that come at once, and not the last of them
# Of hazards in lockstep, see controller.py:
REFUSED = -8  # a state is one of those
REFUSED_LONG = -9  # all of them have been for so long that it is a fault


@kernel
def answer(core: Any, wire: Any, data: bytes, now: int, monotonic: int) -> int:
    """Answer a state message; the command message is written to the shared arrays.

    Args:
        core: See Core.
        wire: Layout of the message with position, velocity and effort, see Wire.
        data: The serialised message.
        now: Time on the clock of the stamps [ns]; 0: the age of the state is not checked.
        monotonic: Time on the monotonic clock [ns].

    Returns:
        ANSWERED and further bits, or the reason why there is no answer.
    """
    common = core.common
    acted, before = common.numbers[ACTED], common.state
    row = core.setup.limits.torque
    estimator = core.setup.estimator
    tracks = estimator.kind == KALMAN
    delay = lock_in.delay_at(estimator.lock_in, estimator.delay, before.last.known)
    question = _open(common, wire, data, now, monotonic, row, tracks, delay)
    if question.code != ANSWERED:
        return question.code
    stamps = question.stamps
    sample = stamps.acts // common.timing.period
    done = core.cycle(
        core.setup,
        question.reference,
        question.position,
        question.velocity,
        question.effort,
        common.state,
        When(sample, (stamps.acts - stamps.stamp) / NANOSECONDS, question.dt),
    )
    common.state = done.state
    write_row(common.telemetry, COUPLED, done.coupled_error)
    write_row(common.telemetry, SLIDING, done.sliding_variable)
    write_row(common.torques, 0, done.torque)
    write_row(common.commanded, common.numbers[LOGGED] % AGES, done.torque)
    write_row(common.efforts, common.numbers[LOGGED] % AGES, question.effort)
    phase = lock_in.phase(estimator.lock_in, sample)
    code = _close(common, stamps, done.acted, done.cause, phase, now, monotonic)
    numbers, after = common.numbers, done.state
    if numbers[ACTED] != acted or after.fault != before.fault or after.lost != before.lost:
        code |= STATUS
    return code


class Stamps(NamedTuple):
    """Times of an answer [ns]."""

    stamp: int  # stamp of the state
    acts: int  # stamp of the sample from which on the torque acts, as far as it counts
    now: int  # the same, whether it counts or not
    known: int  # stamp of the reference used
    before: int  # stamp of the state answered before; NEVER if there is none
    stale: bool  # whether the reference is too old


class Question(NamedTuple):
    """A state with everything that is needed to answer it."""

    code: int  # ANSWERED if the state can be answered, else the reason why not
    stamps: Stamps  # times of the answer
    reference: JointReference  # desired joint motion when the torque acts
    position: Array  # measured angles [rad], shape (n,)
    velocity: Array  # measured rates [rad/s], shape (n,)
    effort: Array  # torque applied before the state [N m], shape (n,); NaN where it is not known
    dt: float  # time since the previous state [s]


@inner
def _open(
    common: Any,
    wire: Any,
    data: bytes,
    now: int,
    monotonic: int,
    row: Array,
    tracks: bool,
    delay: float,
) -> Question:
    """Read a state, check whether it can be answered, and find its reference.

    If it can, the state of the controller is made what the cycle begins with.

    In lockstep the first state tells the age of all: its torque acts from the start on. In wall
    time a torque acts at the end of the period in which it is asked for; this counts only with an
    estimator that predicts.

    `row` is any vector of shape (n,); `tracks`: whether the estimator predicts; `delay`: age that
    the stamps do not tell [s].
    """
    timing, numbers, state = common.timing, common.numbers, common.state
    stamp = open_message(wire, data)
    position = read_row(joint_row(wire, 0), 0, row)
    velocity = read_row(joint_row(wire, 1), 0, row)
    effort = read_row(joint_row(wire, 2, np.nan), 0, row)
    applied = select(effort - effort == 0.0, effort, 0.0)  # zero where it is not known
    before, last = numbers[LAST], state.last
    code, lookup, known, dt = ANSWERED, MISSING, 0, timing.period / NANOSECONDS
    reference = JointReference(position, velocity, velocity)
    acting = stamp  # when its torque acts
    if timing.lockstep:
        if before == NEVER:
            numbers[AGE] = 0
            if 0 < numbers[START] - stamp <= OLDEST:
                numbers[AGE] = numbers[START] - stamp
        acting += numbers[AGE]
    elif now > stamp:
        acting += (now - stamp) // timing.period * timing.period
    acts = acting if timing.lockstep or tracks else stamp
    if stamp == NOT_UNDERSTOOD or not (is_finite(position) and is_finite(velocity)):
        code = UNKNOWN
    elif acting < numbers[FROM]:
        code = EARLY
    elif (
        not timing.lockstep
        and numbers[HEARD]
        and monotonic - numbers[HEARD] > timing.state_timeout
    ):
        code = STALE
    elif not timing.lockstep and now > stamp + timing.state_age:
        code = OLD
    elif not timing.lockstep and now != 0 and now < stamp - timing.state_age:
        code = AHEAD
    elif not timing.lockstep and now != 0 and _is_queued(common, now, stamp):
        code = OVERTAKEN
    elif before != NEVER and (
        stamp <= before or (stamp - before >= RESTART and not timing.lockstep)
    ):
        code = OUT_OF_ORDER
    else:
        lookup, known, reference = reference_at(
            common.references,
            acts,
            numbers[UNTIL],
            timing.reference_timeout,
            timing.lockstep,
            row,
        )
        if lookup == MISSING:
            code = NO_REFERENCE
    if code == ANSWERED:
        torque, cause = last.torque, faults.NONE
        gap = timing.lockstep and before != NEVER and stamp - before > timing.state_timeout
        if gap:
            torque, cause = np.zeros_like(row), faults.STATES_STALE
        elif lookup == TOO_OLD:
            cause = faults.REFERENCE_STALE
        write_row(common.measured, 0, position)
        write_row(common.measured, 1, velocity)
        write_row(common.measured, 2, applied)
        then = moved_on(reference, (stamp - acts) / NANOSECONDS - delay)
        write_row(common.telemetry, ERROR, then.position - position)
        write_row(common.telemetry, ERROR_RATE, then.velocity - velocity)
        overdue = acts - known > OVERDUE * NANOSECONDS
        joins = numbers[WAITS] != 0 and not overdue
        if before != NEVER:
            dt = (stamp - before) / NANOSECONDS
        elif not stamp <= numbers[START] <= acting:  # continue from the torque that acts
            torque, joins = applied, True
        numbers[WAITS] = overdue
        numbers[LAST] = stamp
        common.state = before_cycle(state, torque, cause, joins)
    numbers[CAME] = now
    stamps = Stamps(stamp, acts, acting, known, before, lookup == TOO_OLD)
    return Question(code, stamps, reference, position, velocity, effort, dt)


@inner
def _is_queued(common: Any, now: int, stamp: int) -> bool:
    """Whether a state is one of many that come at once, with a younger one right behind it.

    They were held up. Answered each, the law would take many steps between two samples of the
    motors, though the torque of none of them has moved the robot before the next one.
    """
    numbers, period = common.numbers, common.timing.period
    at_once = now - numbers[CAME] < period // 2
    return bool(at_once and now - stamp > numbers[YOUNGEST] + QUEUED * period)


@inner
def _close(
    common: Any, stamps: Stamps, acted: int, cause: int, phase: int, now: int, monotonic: int
) -> int:
    """Note what a cycle did and when, and return the bits of the answer."""
    numbers, period = common.numbers, common.timing.period
    stamp, before = stamps.stamp, stamps.before
    acts = acted + select(numbers[WAITS] != 0, limiting.REFERENCE, 0)
    if acts:
        numbers[ACTED] |= acts
        numbers[ACTED_AT] = stamp
    elif numbers[ACTED] and stamp - numbers[ACTED_AT] >= QUIET * NANOSECONDS:
        numbers[ACTED] = 0  # what acts next is told
    numbers[CAUSE] = cause
    if stamps.stale and cause == faults.NONE:
        numbers[CAUSE] = faults.REFERENCE_STALE
    common.log[numbers[LOGGED] % AGES, 0] = stamp
    common.log[numbers[LOGGED] % AGES, 1] = stamps.known
    common.log[numbers[LOGGED] % AGES, 2] = stamps.acts
    numbers[LOGGED] += 1
    age = max(0, now - stamp)
    common.ages[numbers[ANSWERS] % AGES] = age
    if now != 0:
        numbers[YOUNGEST] = min(age, numbers[YOUNGEST] + period // AGEING)
    numbers[ANSWERS] += 1
    ended = numbers[END] != NEVER and stamps.now >= numbers[END]
    numbers[HEARD] = 0 if ended else monotonic
    index = stamps.acts // period
    index_before = (before + numbers[AGE]) // period
    numbers[AGE] = stamps.acts - stamp
    code = ANSWERED
    if index % SLOW == 0 or (before != NEVER and index // SLOW != index_before // SLOW):
        code |= TELEMETRY | LOG
    if ended or numbers[LOGGED] == AGES:
        code |= LOG
    if numbers[PHASE] != phase:
        code |= STATUS
    numbers[PHASE] = phase
    return code


# Which states were answered, from which references, and how old they were then.


class AnswerLog:
    """The record that the kernels keep of each answer, collected from time to time."""

    def __init__(self, arrays: Shared, period: int) -> None:
        """Prepare the log; `arrays` are shared with the kernels, `period` is in ns."""
        # how often states come and are skipped, of what was collected
        self.rhythm = StateRhythm(period)
        self.held = HeldCommands()  # whether each command acts for several states
        self._arrays = arrays
        self._numbers = arrays.numbers
        self._ages_taken = 0

    @property
    def answered(self) -> int:
        """Number of states that were answered."""
        return int(self._numbers[ANSWERS])

    def zero_command(self) -> bytes:
        """A command of zero torque that answers no state, and is logged as such."""
        row = self._numbers[LOGGED] % AGES
        for each in (self._arrays.log, self._arrays.commanded, self._arrays.efforts):
            each[row] = 0
        self._numbers[LOGGED] += 1
        return layouts.float64_multi_array(len(self._arrays.torques)).template.tobytes()

    def take(self) -> bytes:
        """Message of ``controller/answered``: which states were answered since the last call."""
        count = min(int(self._numbers[LOGGED]), AGES)
        self._numbers[LOGGED] = 0
        self.rhythm.note(self._arrays.log[:count, 0].copy())
        self.held.note(self._arrays.efforts[:count].copy(), self._arrays.commanded[:count].copy())
        return answers_message(self._arrays.log[:count], self._arrays.commanded[:count])

    def take_ages(self) -> Array:
        """Ages of the states answered since the last call [s]; at most the newest AGES of them."""
        rows = np.arange(max(self._ages_taken, self.answered - AGES), self.answered) % AGES
        self._ages_taken = self.answered
        return self._arrays.ages[rows] / NANOSECONDS
