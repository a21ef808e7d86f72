"""One state message in, one command message out: everything in between, compiled.

What a controller keeps from one state to the next is in the core of its law: see law_core.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control import faults, lock_in, safety
from parallel_robot_control.approach import BACK
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import (
    Acted,
    CycleState,
    When,
    at_measurement,
    is_finite,
)
from parallel_robot_control.estimator import KALMAN, Estimated
from parallel_robot_control.message_kernels import NOT_UNDERSTOOD, joint_row, open_message
from parallel_robot_control.reference_buffer import MISSING, RESTART, TOO_OLD, reference_at
from parallel_robot_control.safety import OVERDUE, QUIET, Last
from parallel_robot_control.shared_arrays import (
    ACTED,
    ACTED_AT,
    AGE,
    AGES,
    ANSWERS,
    BEGINS,
    CAUSE,
    COUPLED,
    EFFORT,
    END,
    ERROR,
    ERROR_RATE,
    EXCESS,
    FAULT,
    FROM,
    HEARD,
    HELD,
    KNOWN,
    LAST,
    LOGGED,
    NEVER,
    OFFSET,
    PHASE,
    POSE_LOST,
    POSITION,
    RATE,
    REFERENCE,
    SLIDING,
    START,
    TAKES_OVER,
    TORQUE,
    TRACKED,
    UNTIL,
    VELOCITY,
    WAITS,
)
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.compiler import inner, kernel, read_row, select, write_row
from parallel_robot_model.configuration.loop import OLDEST
from parallel_robot_model.messages.topics import SLOW

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
# Of hazards in lockstep, see controller.py:
REFUSED = -8  # a state is one of those
REFUSED_LONG = -9  # all of them have been for so long that it is a fault


@kernel
def answer(core: Any, wire: Any, data: bytes, now: int, monotonic: int) -> int:
    """Answer a state message; the command message is written to the shared arrays.

    Only this function is compiled for each law; what it calls is compiled once.

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
    acted = common.numbers[ACTED]
    row = core.setup.limits.torque
    estimator = core.setup.estimator
    tracks = estimator.kind == KALMAN
    known = common.numbers[KNOWN] != 0
    delay = lock_in.delay_at(estimator.lock_in, estimator.delay, known, row)
    question = _open(common, wire, data, now, monotonic, row, core.pose, tracks, delay)
    if question.code != ANSWERED:
        return question.code
    done = core.cycle(
        core.setup,
        question.reference,
        question.position,
        question.velocity,
        question.effort,
        question.state,
        core.memory,
        When(question.acts // common.timing.period, question.age, question.dt),
    )
    core.memory = done.memory
    phase = lock_in.phase(estimator.lock_in, question.acts // common.timing.period, row)
    answered = Acted(
        done.torque,
        done.sliding_variable,
        done.coupled_error,
        done.acted,
        done.cause,
        done.state,
    )
    return _close(common, question, answered, acted, phase, now, monotonic)


class Question(NamedTuple):
    """A state with everything that is needed to answer it.

    Attributes:
        code: ANSWERED if the state can be answered, else the reason why not.
        stamp: Stamp of the state [ns].
        acts: Stamp of the sample from which on the torque acts [ns], as far as it counts.
        now: The same, whether it counts or not.
        known: Stamp of the reference used [ns].
        before: Stamp of the state answered before [ns]; NEVER if there is none.
        fault: Fault of the controller before this state.
        stale: Whether the reference is too old.
        reference: Desired joint motion when the torque acts.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        effort: Torque applied before the state [N m], shape (n,); NaN where it is not known.
        state: State of the controller after the cycle before.
        age: From the stamp until the torque acts [s].
        dt: Time since the previous state [s].
    """

    code: int
    stamp: int
    acts: int
    now: int
    known: int
    before: int
    fault: int
    stale: bool
    reference: JointReference
    position: Array
    velocity: Array
    effort: Array
    state: CycleState
    age: float
    dt: float


@inner
def _open(
    common: Any,
    wire: Any,
    data: bytes,
    now: int,
    monotonic: int,
    row: Array,
    pose: Array,
    tracks: bool,
    delay: float,
) -> Question:
    """Read a state, check whether it can be answered, and find its reference.

    In lockstep the first state tells the age of all: its torque acts from the start on. In wall
    time a torque acts at the end of the period in which it is asked for; this counts only with an
    estimator that predicts.

    `row` is any vector of shape (n,), `pose` any of shape (m,); `tracks`: whether the estimator
    predicts; `delay`: age that the stamps do not tell [s].
    """
    timing, numbers, vectors = common.timing, common.numbers, common.vectors
    stamp = open_message(wire, data)
    position = read_row(joint_row(wire, 0), 0, row)
    velocity = read_row(joint_row(wire, 1), 0, row)
    effort = read_row(joint_row(wire, 2, np.nan), 0, row)
    applied = select(effort - effort == 0.0, effort, 0.0)  # zero where it is not known
    before, fault = numbers[LAST], numbers[FAULT]
    code, found, known, dt = ANSWERED, MISSING, 0, timing.period / NANOSECONDS
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
    elif before != NEVER and (
        stamp <= before or (stamp - before >= RESTART and not timing.lockstep)
    ):
        code = OUT_OF_ORDER
    else:
        found, known, reference = reference_at(
            common.references,
            acts,
            numbers[UNTIL],
            timing.reference_timeout,
            timing.lockstep,
            row,
        )
        if found == MISSING:
            code = NO_REFERENCE
    if code == ANSWERED:
        gap = timing.lockstep and before != NEVER and stamp - before > timing.state_timeout
        if fault == faults.NONE and (gap or found == TOO_OLD):
            numbers[FAULT] = select(gap, faults.STATES_STALE, faults.REFERENCE_STALE)
            write_row(vectors, HELD, read_row(vectors, POSITION, row))
        if gap:
            write_row(vectors, TORQUE, np.zeros_like(row))
        write_row(vectors, VELOCITY, velocity)
        write_row(vectors, EFFORT, applied)
        then = at_measurement(reference, (acts - stamp) / NANOSECONDS + delay)
        write_row(common.telemetry, ERROR, then.position - position)
        write_row(common.telemetry, ERROR_RATE, then.velocity - velocity)
        overdue = acts - known > OVERDUE * NANOSECONDS
        joins = numbers[WAITS] != 0 and not overdue
        if before != NEVER:
            dt = (stamp - before) / NANOSECONDS
        elif not stamp <= numbers[START] <= acting:  # continue from the torque that acts
            write_row(vectors, TORQUE, applied)
            joins = True
        if joins:  # see transitions.joining
            write_row(vectors, EXCESS, np.zeros_like(row))
            numbers[TAKES_OVER] = 1
            numbers[BEGINS] = BACK
        numbers[WAITS] = overdue
        numbers[LAST] = stamp
    last = Last(
        read_row(vectors, POSITION, row),
        read_row(vectors, REFERENCE, row),
        read_row(vectors, TORQUE, row),
        read_row(vectors, OFFSET, row),
        numbers[TAKES_OVER] != 0,
        numbers[KNOWN] != 0,
    )
    state = CycleState(
        read_row(common.pose, 0, pose),
        last,
        read_row(vectors, EXCESS, row),
        read_row(vectors, HELD, row),
        numbers[FAULT],
        Estimated(read_row(vectors, TRACKED, row), read_row(vectors, RATE, row)),
        numbers[BEGINS],
        numbers[POSE_LOST] != 0,
    )
    age = (acts - stamp) / NANOSECONDS
    return Question(
        code,
        stamp,
        acts,
        acting,
        known,
        before,
        fault,
        found == TOO_OLD,
        reference,
        position,
        velocity,
        effort,
        state,
        age,
        dt,
    )


@inner
def _close(
    common: Any,
    question: Question,
    done: Acted,
    acted: int,
    phase: int,
    now: int,
    monotonic: int,
) -> int:
    """Store the result of a cycle, write its command, and return the bits of the answer."""
    v, numbers, after = common.vectors, common.numbers, done.state
    numbers[FAULT] = after.fault
    numbers[TAKES_OVER] = after.last.takes_over
    numbers[KNOWN] = after.last.known
    acts = done.acted + select(numbers[WAITS] != 0, safety.REFERENCE, 0)
    if acts:
        numbers[ACTED] |= acts
        numbers[ACTED_AT] = question.stamp
    elif numbers[ACTED] and question.stamp - numbers[ACTED_AT] >= QUIET * NANOSECONDS:
        numbers[ACTED] = 0  # what acts next is told
    write_row(v, POSITION, after.last.position)
    write_row(v, REFERENCE, after.last.reference)
    write_row(v, TORQUE, after.last.torque)
    write_row(v, OFFSET, after.last.offset)
    write_row(v, EXCESS, after.excess)
    write_row(v, HELD, after.held)
    write_row(v, TRACKED, after.estimated.position)
    write_row(v, RATE, after.estimated.velocity)
    numbers[BEGINS] = after.begins
    numbers[CAUSE] = done.cause
    if question.stale and done.cause == faults.NONE:
        numbers[CAUSE] = faults.REFERENCE_STALE
    write_row(common.telemetry, COUPLED, done.coupled_error)
    write_row(common.telemetry, SLIDING, done.sliding_variable)
    write_row(common.torques, 0, done.torque)
    write_row(common.pose, 0, after.pose)
    stamp, before, period = question.stamp, question.before, common.timing.period
    common.log[numbers[LOGGED] % AGES, 0] = stamp
    common.log[numbers[LOGGED] % AGES, 1] = question.known
    common.log[numbers[LOGGED] % AGES, 2] = question.acts
    numbers[LOGGED] += 1
    common.ages[numbers[ANSWERS] % AGES] = max(0, now - stamp)
    numbers[ANSWERS] += 1
    ended = numbers[END] != NEVER and question.now >= numbers[END]
    numbers[HEARD] = 0 if ended else monotonic
    index = question.acts // period
    index_before = (before + numbers[AGE]) // period
    numbers[AGE] = question.acts - stamp
    code = ANSWERED
    if index % SLOW == 0 or (before != NEVER and index // SLOW != index_before // SLOW):
        code |= TELEMETRY | LOG
    if ended or numbers[LOGGED] == AGES:
        code |= LOG
    if numbers[FAULT] != question.fault or numbers[ACTED] != acted or numbers[PHASE] != phase:
        code |= STATUS
    if numbers[POSE_LOST] != after.lost:
        code |= STATUS
    numbers[POSE_LOST] = after.lost
    numbers[PHASE] = phase
    return code
