"""One state message in, one command message out: everything in between, compiled.

What a controller keeps from one state to the next is in the core of its law: see law_core.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.cycle import before_cycle
from parallel_robot_control.estimation import lock_in
from parallel_robot_control.estimation.estimator import KALMAN
from parallel_robot_control.joint_states import HeldCommands, StateRhythm
from parallel_robot_control.messages import (
    NOT_UNDERSTOOD,
    answers_message,
    joint_row,
    parse_stamped,
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
    internal,
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
AGES = 4096  # answers for which the age of the state is recorded
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
    active_limits: int = 0  # bits of the active limits
    limits_stamp: int = 0  # stamp of the last state at which one did
    cause: int = faults.NONE  # fault whose cause was there at the last state
    answer_time: int = 0  # time of the last answer on the monotonic clock; 0: none, or the end
    logged: int = 0  # rows of the log
    answers: int = 0  # how many there were
    age: int = 0  # of the last state, from the measurement until the torque acts
    phase: int = lock_in.OFF  # of the identification of the delay
    until: int = FOREVER  # stamp of the newest reference that counts
    waits: bool = False  # whether the last reference was overdue
    arrival_time: int = NEVER  # when the last state came, on the clock of the stamps
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
        wire: Layout of the message with position, velocity and effort, see MessageLayout.
        data: The serialised message.
        now: Time on the clock of the stamps [ns]; 0: the age of the state is not checked.
        monotonic: Time on the monotonic clock [ns].

    Returns:
        ANSWERED and further bits, or the reason why there is no answer.
    """
    common, setup = core.common, core.setup
    timing, state, before = common.timing, setup.memory.state, common.last
    row, status_before = setup.safety.torque_limit, (common.active_limits, state.fault, state.lost)
    stamp = parse_stamped(wire, data)
    position = read_row(joint_row(wire, 0), 0, row)
    velocity = read_row(joint_row(wire, 1), 0, row)
    effort = read_row(joint_row(wire, 2, np.nan), 0, row)
    # 1. When its torque acts. In lockstep the first state tells the age of all: its torque acts
    # from the start on. In wall time a torque acts at the end of the period in which it is asked
    # for; this counts only with an estimator that predicts.
    acting = stamp
    if timing.lockstep:
        if before == NEVER:
            since = common.start - stamp
            common.age = since if 0 < since <= OLDEST else 0
        acting += common.age
    elif now > stamp:
        acting += (now - stamp) // timing.period * timing.period
    acts = acting if timing.lockstep or setup.estimator.kind == KALMAN else stamp
    # 2. Whether it can be answered, and its reference.
    code = UNKNOWN
    if is_finite(position) and is_finite(velocity):
        code = _refusal(common, stamp, acting, now, monotonic)
    common.arrival_time = now
    if code != ANSWERED:
        return code
    lookup, known, reference = reference_at(
        common.references, acts, common.until, timing.reference_timeout, timing.lockstep, row
    )
    if lookup == MISSING:
        return NO_REFERENCE
    # 3. What the cycle begins with.
    applied = select(effort - effort == 0.0, effort, 0.0)  # zero where it is not known
    torque, cause, dt = state.torque, faults.NONE, timing.period / NANOSECONDS
    if timing.lockstep and before != NEVER and stamp - before > timing.state_timeout:
        torque, cause = np.zeros_like(row), faults.STATES_STALE
    elif lookup == TOO_OLD:
        cause = faults.REFERENCE_STALE
    overdue = acts - known > OVERDUE * NANOSECONDS
    joins = common.waits and not overdue
    if before != NEVER:
        dt = (stamp - before) / NANOSECONDS
    elif not stamp <= common.start <= acting:  # continue from the torque that acts
        torque, joins = applied, True
    common.waits, common.last = overdue, stamp
    before_cycle(state, torque, cause, joins)
    # 4. The cycle, and what is noted of it.
    sample, at = acts // timing.period, common.logged % AGES
    when = When(sample, (acts - stamp) / NANOSECONDS, dt)
    done = core.cycle(setup, reference, position, velocity, effort, when)
    write_row(common.measured, 0, vector((position, velocity, applied)))
    common.telemetry = done.telemetry
    write_row(common.torques, 0, done.torque)
    write_row(common.commanded, at, done.torque)
    write_row(common.efforts, at, effort)
    common.log[at, 0], common.log[at, 1], common.log[at, 2] = stamp, known, acts
    common.logged += 1
    active_limits = done.active_limits + select(overdue, limiting.REFERENCE, 0)
    if active_limits:
        common.active_limits |= active_limits
        common.limits_stamp = stamp
    elif common.active_limits and stamp - common.limits_stamp >= QUIET * NANOSECONDS:
        common.active_limits = 0  # what acts next is reported
    common.cause = done.cause
    if lookup == TOO_OLD and done.cause == faults.NONE:
        common.cause = faults.REFERENCE_STALE
    age = max(0, now - stamp)
    common.ages[common.answers % AGES] = age
    if now != 0:
        common.youngest = min(age, common.youngest + timing.period // AGEING)
    common.answers += 1
    ended = common.end != NEVER and acting >= common.end
    common.answer_time = 0 if ended else monotonic
    # 5. What is due to be told.
    sample_before, phase = (before + common.age) // timing.period, lock_in.phase(setup, sample)
    common.age = acts - stamp
    if sample % SLOW == 0 or (before != NEVER and sample // SLOW != sample_before // SLOW):
        code |= TELEMETRY | LOG
    if ended or common.logged == AGES:
        code |= LOG
    if common.phase != phase or status_before != (common.active_limits, state.fault, state.lost):
        code |= STATUS
    common.phase = phase
    return code


@internal
def _refusal(common: Any, stamp: int, acting: int, now: int, monotonic: int) -> int:
    """Why a state cannot be answered whatever its reference; ANSWERED if it can."""
    timing, before = common.timing, common.last
    if stamp == NOT_UNDERSTOOD:
        return UNKNOWN
    if acting < common.first:
        return EARLY
    if not timing.lockstep:
        if common.answer_time and monotonic - common.answer_time > timing.state_timeout:
            return STALE
        if now > stamp + timing.state_age:
            return OLD
        if now != 0 and now < stamp - timing.state_age:
            return AHEAD
        if now != 0 and _is_queued(common, now, stamp):
            return OVERTAKEN
    back = stamp <= before or (stamp - before >= RESTART and not timing.lockstep)
    return OUT_OF_ORDER if before != NEVER and back else ANSWERED


@internal
def _is_queued(common: Any, now: int, stamp: int) -> bool:
    """Whether a state is one of many that come at once, with a younger one right behind it.

    They were held up. Answered each, the law would take many steps between two samples of the
    motors, though the torque of none of them has moved the robot before the next one.
    """
    period = common.timing.period
    at_once = now - common.arrival_time < period // 2
    return bool(at_once and now - stamp > common.youngest + QUEUED * period)


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
