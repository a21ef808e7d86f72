"""One state message in, one command message out: everything in between, compiled.

What a controller keeps from one state to the next is in the core of its law: see law_core.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import before_cycle
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
    reference_at,
)
from parallel_robot_control.safety import faults, limiting
from parallel_robot_control.safety.limiting import OVERDUE, QUIET, When
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import (
    Boxed,
    Struct,
    inner,
    is_finite,
    kernel,
    read_row,
    select,
    vector,
    write_row,
)
from parallel_robot_model.configuration.loop import OLDEST
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import SLOW, Telemetry

# What controller and kernels share, whatever the law: Python reads it between two calls.

NEVER = -1  # a stamp that no message has
FOREVER = 2**63 - 1  # ns
AGES = 4096  # answers for which the age of the state is kept
QUEUED = 1  # periods by which a state of a burst is older than others: a younger one is behind it
AGEING = 250  # states after which the least age counts as a period larger


class Timing(NamedTuple):
    """Times [ns], and whether the plant waits for each command."""

    period: int
    reference_timeout: int
    state_timeout: int
    state_age: int
    lockstep: bool


class Common(NamedTuple):
    """References, times and the last answer, as a Struct; stamps and times in [ns]."""

    references: Boxed  # see reference_buffer.Buffer
    timing: Timing
    measured: Array  # position, velocity and effort of the last state, shape (3, n)
    telemetry: Telemetry  # of the last answer
    command: NDArray[np.uint8]  # the command message of the last answer, serialised
    torques: Array  # the torques in it [N m], shape (n,)
    # stamps of state and reference of each answer, and when its torque acts, shape (AGES, 3)
    log: NDArray[np.int64]
    commanded: Array  # torques of each answer in the log [N m], shape (AGES, n)
    efforts: Array  # measured efforts of the states in the log [N m], shape (AGES, n)
    ages: NDArray[np.int64]  # ages of the states when they were answered, shape (AGES,)
    last: int = NEVER  # stamp of the last answer,
    first: int = 0  # of the first state to answer,
    start: int = NEVER  # of the start
    end: int = NEVER  # and of the end of the motion
    acted: int = 0  # bits of the limits that acted
    acted_at: int = 0  # stamp of the last state at which one did
    cause: int = faults.NONE  # fault whose cause was there at the last state
    heard: int = 0  # time of the last answer on the monotonic clock; 0: none, or the end
    logged: int = 0  # rows of the log
    answers: int = 0  # how many there were
    age: int = 0  # of the last state, from the measurement until the torque acts
    phase: int = lock_in.OFF  # of the identification of the delay
    until: int = FOREVER  # stamp of the newest reference that counts
    waits: bool = False  # whether the last reference was overdue
    came: int = NEVER  # when the last state came, on the clock of the stamps
    youngest: int = FOREVER // 2  # about the least age that states have when they are answered


def common_of(references: Boxed, timing: Timing, joints: int) -> Struct:
    """What is shared before the first state; `joints`: number of the actuated joints, n."""
    command = layouts.float64_multi_array(joints).draft()
    return Struct(
        Common(
            references,
            timing,
            np.zeros((3, joints)),
            Telemetry(*[vector(np.zeros(joints))] * len(Telemetry._fields)),
            command.bytes,
            command.fields['data'],
            np.zeros((AGES, 3), np.int64),
            np.zeros((AGES, joints)),
            np.zeros((AGES, joints)),
            np.zeros(AGES, np.int64),
        )
    )


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
    state = core.setup.memory.state
    acted, fault, lost = common.acted, state.fault, state.lost
    question = _open(core.setup, common, wire, data, now, monotonic)
    if question.code != ANSWERED:
        return question.code
    sample = question.acts // common.timing.period
    done = core.cycle(
        core.setup,
        question.reference,
        question.position,
        question.velocity,
        question.effort,
        When(sample, (question.acts - question.stamp) / NANOSECONDS, question.dt),
    )
    common.telemetry = done.telemetry
    write_row(common.torques, 0, done.torque)
    write_row(common.commanded, common.logged % AGES, done.torque)
    write_row(common.efforts, common.logged % AGES, question.effort)
    phase = lock_in.phase(core.setup, sample)
    code = _close(common, question, done.acted, done.cause, phase, now, monotonic)
    if common.acted != acted or state.fault != fault or state.lost != lost:
        code |= STATUS
    return code


class Question(NamedTuple):
    """A state with everything that is needed to answer it; stamps in [ns]."""

    code: int  # ANSWERED if the state can be answered, else the reason why not
    stamp: int  # of the state
    acts: int  # of the sample from which on the torque acts, as far as it counts
    acting: int  # the same, whether it counts or not
    known: int  # of the reference used
    before: int  # of the state answered before; NEVER if there is none
    stale: bool  # whether the reference is too old
    reference: JointReference  # desired joint motion when the torque acts
    position: Array  # measured angles [rad], shape (n,)
    velocity: Array  # measured rates [rad/s], shape (n,)
    effort: Array  # torque applied before the state [N m], shape (n,); NaN where it is not known
    dt: float  # time since the previous state [s]


@inner
def _open(setup: Any, common: Any, wire: Any, data: bytes, now: int, monotonic: int) -> Question:
    """Read a state, check whether it can be answered, and find its reference.

    If it can, the state of the controller is made what the cycle begins with.

    In lockstep the first state tells the age of all: its torque acts from the start on. In wall
    time a torque acts at the end of the period in which it is asked for; this counts only with an
    estimator that predicts.
    """
    timing, state = common.timing, setup.memory.state
    row, tracks = setup.safety.torque_limit, setup.estimator.kind == KALMAN
    stamp = open_message(wire, data)
    position = read_row(joint_row(wire, 0), 0, row)
    velocity = read_row(joint_row(wire, 1), 0, row)
    effort = read_row(joint_row(wire, 2, np.nan), 0, row)
    applied = select(effort - effort == 0.0, effort, 0.0)  # zero where it is not known
    before = common.last
    code, lookup, known, dt = ANSWERED, MISSING, 0, timing.period / NANOSECONDS
    reference = JointReference(position, velocity, velocity)
    acting = stamp  # when its torque acts
    if timing.lockstep:
        if before == NEVER:
            common.age = 0
            if 0 < common.start - stamp <= OLDEST:
                common.age = common.start - stamp
        acting += common.age
    elif now > stamp:
        acting += (now - stamp) // timing.period * timing.period
    acts = acting if timing.lockstep or tracks else stamp
    if stamp == NOT_UNDERSTOOD or not (is_finite(position) and is_finite(velocity)):
        code = UNKNOWN
    elif acting < common.first:
        code = EARLY
    elif not timing.lockstep and common.heard and monotonic - common.heard > timing.state_timeout:
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
            common.until,
            timing.reference_timeout,
            timing.lockstep,
            row,
        )
        if lookup == MISSING:
            code = NO_REFERENCE
    if code == ANSWERED:
        torque, cause = state.torque, faults.NONE
        gap = timing.lockstep and before != NEVER and stamp - before > timing.state_timeout
        if gap:
            torque, cause = np.zeros_like(row), faults.STATES_STALE
        elif lookup == TOO_OLD:
            cause = faults.REFERENCE_STALE
        write_row(common.measured, 0, position)
        write_row(common.measured, 1, velocity)
        write_row(common.measured, 2, applied)
        overdue = acts - known > OVERDUE * NANOSECONDS
        joins = common.waits and not overdue
        if before != NEVER:
            dt = (stamp - before) / NANOSECONDS
        elif not stamp <= common.start <= acting:  # continue from the torque that acts
            torque, joins = applied, True
        common.waits = overdue
        common.last = stamp
        before_cycle(state, torque, cause, joins)
    common.came = now
    stale = lookup == TOO_OLD
    return Question(
        code,
        stamp,
        acts,
        acting,
        known,
        before,
        stale,
        reference,
        position,
        velocity,
        effort,
        dt,
    )


@inner
def _is_queued(common: Any, now: int, stamp: int) -> bool:
    """Whether a state is one of many that come at once, with a younger one right behind it.

    They were held up. Answered each, the law would take many steps between two samples of the
    motors, though the torque of none of them has moved the robot before the next one.
    """
    period = common.timing.period
    at_once = now - common.came < period // 2
    return bool(at_once and now - stamp > common.youngest + QUEUED * period)


@inner
def _close(
    common: Any, question: Question, acted: int, cause: int, phase: int, now: int, monotonic: int
) -> int:
    """Note what a cycle did and when, and return the bits of the answer."""
    period = common.timing.period
    stamp, before = question.stamp, question.before
    acts = acted + select(common.waits, limiting.REFERENCE, 0)
    if acts:
        common.acted |= acts
        common.acted_at = stamp
    elif common.acted and stamp - common.acted_at >= QUIET * NANOSECONDS:
        common.acted = 0  # what acts next is told
    common.cause = cause
    if question.stale and cause == faults.NONE:
        common.cause = faults.REFERENCE_STALE
    common.log[common.logged % AGES, 0] = stamp
    common.log[common.logged % AGES, 1] = question.known
    common.log[common.logged % AGES, 2] = question.acts
    common.logged += 1
    age = max(0, now - stamp)
    common.ages[common.answers % AGES] = age
    if now != 0:
        common.youngest = min(age, common.youngest + period // AGEING)
    common.answers += 1
    ended = common.end != NEVER and question.acting >= common.end
    common.heard = 0 if ended else monotonic
    index = question.acts // period
    index_before = (before + common.age) // period
    common.age = question.acts - stamp
    code = ANSWERED
    if index % SLOW == 0 or (before != NEVER and index // SLOW != index_before // SLOW):
        code |= TELEMETRY | LOG
    if ended or common.logged == AGES:
        code |= LOG
    if common.phase != phase:
        code |= STATUS
    common.phase = phase
    return code


# Which states were answered, from which references, and how old they were then.


class AnswerLog:
    """The record that the kernels keep of each answer, collected from time to time."""

    def __init__(self, common: Any, period: int) -> None:
        """Prepare the log; `common`: a Common, shared with the kernels; `period` in ns."""
        # how often states come and are skipped, of what was collected
        self.rhythm = StateRhythm(period)
        self.held = HeldCommands()  # whether each command acts for several states
        self._common = common
        self._ages_taken = 0

    @property
    def answered(self) -> int:
        """Number of states that were answered."""
        return int(self._common.answers)

    def zero_command(self) -> bytes:
        """A command of zero torque that answers no state, and is logged as such."""
        row = self._common.logged % AGES
        for each in (self._common.log, self._common.commanded, self._common.efforts):
            each[row] = 0
        self._common.logged += 1
        return layouts.float64_multi_array(len(self._common.torques)).template.tobytes()

    def take(self) -> bytes:
        """Message of ``controller/answered``: which states were answered since the last call."""
        count = min(int(self._common.logged), AGES)
        self._common.logged = 0
        self.rhythm.note(self._common.log[:count, 0].copy())
        self.held.note(self._common.efforts[:count].copy(), self._common.commanded[:count].copy())
        return answers_message(self._common.log[:count], self._common.commanded[:count])

    def take_ages(self) -> Array:
        """Ages of the states answered since the last call [s]; at most the newest AGES of them."""
        rows = np.arange(max(self._ages_taken, self.answered - AGES), self.answered) % AGES
        self._ages_taken = self.answered
        return self._common.ages[rows] / NANOSECONDS
