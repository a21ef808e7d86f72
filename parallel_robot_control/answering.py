"""One state message in, one command message out: all that happens between them, compiled.

A Core holds what a controller knows between two states. Its arrays are shared with Python, which
looks at them and changes them between two calls; what depends on the law (gains, memory) lies in
the compiled object alone.
"""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref
from numpy.typing import NDArray

from parallel_robot_base import cdr
from parallel_robot_base.kernel import entry_point, in_memory, inner, kernel
from parallel_robot_base.topics import SLOW
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import faults
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import (
    Acted,
    CycleState,
    cycle_of,
    initial_state,
    is_finite,
    run_cycle,
)
from parallel_robot_control.laws import LAWS, PreparedLaw
from parallel_robot_control.reference_buffer import MISSING, TOO_OLD, reference_at
from parallel_robot_control.safety import Last, Limits
from parallel_robot_control.wire import NOT_UNDERSTOOD, open_message, vector
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]

RESTART = NANOSECONDS // 2  # a jump of the stamps by more than this is a new run of the plant
NEVER = -1  # a stamp that none has
AGES = 4096  # answers of which the age of the state is kept

# What an answer returns: bits, when there is one ...
ANSWERED = 1
STATUS = 2  # a fault or a limit that is new
TELEMETRY = 4  # a sample at which the slow topics are due
LOG = 8  # a sample at which the log of the answers is due
# ... or why there is none.
UNKNOWN = -1  # not understood, or not finite
NO_REFERENCE = -2
OUT_OF_ORDER = -3  # the stamp repeats, goes back or jumps
OLD = -4  # the state is of a time that has gone
STALE = -5  # no state was answered for too long: the controller itself stood still
EARLY = -6  # the state is from before the start

# Rows of Shared.vectors,
POSE, POSITION, REFERENCE, TORQUE, OFFSET, EXCESS, HELD, VELOCITY, EFFORT = range(9)
MEASURED = [POSITION, VELOCITY, EFFORT]
# of Shared.telemetry,
ERROR, ERROR_RATE, COUPLED, SLIDING = range(4)
# and of Shared.numbers.
(
    FAULT, TAKES_OVER, KNOWN, ACTED,  # of the cycle
    LAST, FROM, START, END,  # stamps: last answer, first to answer, start and end of the motion
    HEARD,  # when the last answer was given, on the clock that never jumps; 0: none, or the end
    LOGGED, ANSWERS, SKIPPED,  # counts: rows of the log, answers, states that never came
) = range(12)  # fmt: skip


class Timing(NamedTuple):
    """Times [ns], and whether the plant waits for each command."""

    period: int
    reference_timeout: int
    state_timeout: int
    lockstep: bool


class Shared(NamedTuple):
    """The arrays that Python and the kernels share.

    Attributes:
        vectors: State of the cycle, one row a vector, shape (9, n).
        telemetry: Of the last answer, shape (4, n).
        numbers: Fault, stamps and counts, shape (12,).
        command: The command message of the last answer, serialised.
        torques: The torques in it [N m], shape (n,).
        log: Stamps of state and reference of each answer [ns], shape (AGES, 2).
        ages: Of the states when they were answered [ns], shape (AGES,).
    """

    vectors: Array
    telemetry: Array
    numbers: NDArray[np.int64]
    command: NDArray[np.uint8]
    torques: Array
    log: NDArray[np.int64]
    ages: NDArray[np.int64]


def shared(pose: Array, joints: int) -> Shared:
    """Arrays before the first state; `pose` is where the forward kinematics starts."""
    command = cdr.float64_multi_array(joints).draft()
    made = Shared(
        np.zeros((9, joints)),
        np.zeros((4, joints)),
        np.zeros(12, np.int64),
        command.bytes,
        command.fields['data'],
        np.zeros((AGES, 2), np.int64),
        np.zeros(AGES, np.int64),
    )
    made.numbers[[LAST, START, END]] = NEVER
    store(made, initial_state(pose, joints))
    return made


def stored(arrays: Shared) -> CycleState:
    """The state of the cycle."""
    v, numbers = arrays.vectors.copy(), arrays.numbers
    last = Last(
        v[POSITION],
        v[REFERENCE],
        v[TORQUE],
        v[OFFSET],
        bool(numbers[TAKES_OVER]),
        bool(numbers[KNOWN]),
    )
    return CycleState(v[POSE], last, v[EXCESS], v[HELD], int(numbers[FAULT]))


def store(arrays: Shared, state: CycleState) -> None:
    """Replace the state of the cycle."""
    last = state.last
    arrays.vectors[:VELOCITY] = (
        state.pose,
        last.position,
        last.reference,
        last.torque,
        last.offset,
        state.excess,
        state.held,
    )
    arrays.numbers[[FAULT, TAKES_OVER, KNOWN]] = state.fault, last.takes_over, last.known


@structref.register
class CommonType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a Common."""


class Common(structref.StructRefProxy):  # type: ignore[misc]
    """What does not depend on the law: references, times, the fields of Shared."""


@structref.register
class CoreType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a Core: one for each law."""


class Core(structref.StructRefProxy):  # type: ignore[misc]
    """A law with all that its cycle needs."""


structref.define_boxing(CommonType, Common)
structref.define_constructor(Common, CommonType, ('references', 'timing', *Shared._fields))
structref.define_boxing(CoreType, Core)
structref.define_constructor(
    Core, CoreType, ('cycle', 'update', 'gains', 'robot', 'limits', 'memory', 'common')
)


@kernel
def _common(references: Any, timing: Timing, arrays: Shared) -> Any:
    return Common(
        references,
        timing,
        arrays.vectors,
        arrays.telemetry,
        arrays.numbers,
        arrays.command,
        arrays.torques,
        arrays.log,
        arrays.ages,
    )


def common(references: Any, timing: Timing, arrays: Shared) -> Any:
    """Tie together what the cores of all laws share.

    Args:
        references: ReferenceBuffer.compiled.
        timing: See Timing.
        arrays: See Shared.
    """
    return _common(references, timing, arrays)


@kernel
def _core(
    cycle: Any,
    update: Any,
    gains: Any,
    robot: RobotParameters,
    limits: Limits,
    memory: Any,
    common: Any,
) -> Any:
    return Core(cycle, update, gains, robot, limits, memory, common)


@kernel
def _memory(core: Any) -> Any:
    return core.memory


class LawCore:
    """The compiled core with one law; the cores of all laws share the rest.

    Attributes:
        law: The law.
    """

    def __init__(
        self, law: PreparedLaw, robot: RobotParameters, limits: Limits, common: Any, wire: Any
    ) -> None:
        """Make the core and compile what works with it; the memory is that before the start.

        Args:
            law: The law.
            robot: Nominal robot.
            limits: See SafetyParameters.
            common: See :func:`common`.
            wire: Of states.
        """
        self.law = law
        self._robot, self._limits, self._common = robot, limits, common
        joints = len(limits.torque)
        state = initial_state(np.zeros(3), joints)
        own = law.name not in LAWS
        with in_memory(run_cycle, _core, _memory, answer) if own else nullcontext():
            self._cycle = cycle_of(law.update, law.gains, robot, limits, state, law.memory)
            self._core = self._made(law.memory)
            self._answer = entry_point(answer, self._core, wire, b'', 0, 0)
            _memory(self._core)

    def answer(self, wire: Any, data: bytes, now: int, monotonic: int) -> int:
        """See :func:`answer`."""
        code: int = self._answer(self._core, wire, data, now, monotonic)
        return code

    @property
    def memory(self) -> Any:
        """Memory of the law."""
        return _memory(self._core)

    @memory.setter
    def memory(self, memory: Any) -> None:
        self._core = self._made(memory)

    def _made(self, memory: Any) -> Any:
        law = self.law
        return _core(
            self._cycle, law.update, law.gains, self._robot, self._limits, memory, self._common
        )


@kernel
def answer(core: Any, wire: Any, data: bytes, now: int, monotonic: int) -> int:
    """Answer a state message: the command message stands in the arrays.

    Only this function is compiled for each law; what it calls is compiled once.

    Args:
        core: See Core.
        wire: Of the message: position, velocity, effort.
        data: The message.
        now: Time on the clock of the stamps [ns]; 0: of no matter.
        monotonic: Time on a clock that never jumps [ns].

    Returns:
        ANSWERED and more bits, or why there is no answer.
    """
    common = core.common
    acted = common.numbers[ACTED]
    question = _open(common, wire, data, now, monotonic)
    if question.code != ANSWERED:
        return question.code
    done = core.cycle(
        core.update,
        core.gains,
        core.robot,
        core.limits,
        question.reference,
        question.position,
        question.velocity,
        question.state,
        core.memory,
        question.dt,
    )
    core.memory = done.memory
    answered = Acted(
        done.torque, done.sliding_variable, done.coupled_error, done.acted, done.state
    )
    return _close(common, question, answered, acted, now, monotonic)


class Question(NamedTuple):
    """A state with all that is needed to answer it.

    Attributes:
        code: ANSWERED when it can be, else why not.
        stamp: Of the state [ns].
        known: Stamp of the reference that is used [ns].
        before: Stamp of the state that was answered before [ns], NEVER when there is none.
        fault: That the controller was in before.
        reference: Desired joint motion at the state.
        position: [rad], shape (n,).
        velocity: [rad/s], shape (n,).
        state: Of the cycle before.
        dt: Time since the state before [s].
    """

    code: int
    stamp: int
    known: int
    before: int
    fault: int
    reference: JointReference
    position: Array
    velocity: Array
    state: CycleState
    dt: float


@inner
def _open(common: Any, wire: Any, data: bytes, now: int, monotonic: int) -> Question:
    """Read a state, look whether it can be answered, and find its reference."""
    timing, numbers, vectors = common.timing, common.numbers, common.vectors
    stamp = open_message(wire, data)
    position, velocity, effort = vector(wire, 0), vector(wire, 1), vector(wire, 2)
    before, fault = numbers[LAST], numbers[FAULT]
    code, known, dt = ANSWERED, 0, timing.period / NANOSECONDS
    reference = JointReference(position, velocity, velocity)
    if stamp == NOT_UNDERSTOOD or not (is_finite(position) and is_finite(velocity)):
        code = UNKNOWN
    elif stamp < numbers[FROM]:
        code = EARLY
    elif (
        not timing.lockstep
        and numbers[HEARD]
        and monotonic - numbers[HEARD] > timing.state_timeout
    ):
        code = STALE
    elif not timing.lockstep and now > stamp + timing.state_timeout:
        code = OLD
    elif before != NEVER and not 0 < stamp - before < RESTART:
        code = OUT_OF_ORDER
    else:
        found, known, reference = reference_at(
            common.references, stamp, timing.reference_timeout, timing.lockstep
        )
        if found == MISSING:
            code = NO_REFERENCE
        if found == TOO_OLD and fault == faults.NONE:
            numbers[FAULT] = faults.REFERENCE_STALE
            vectors[HELD] = vectors[POSITION]
    if code == ANSWERED:
        for i in range(len(effort)):
            if not np.isfinite(effort[i]):
                effort[i] = 0.0
            vectors[VELOCITY, i] = velocity[i]
            vectors[EFFORT, i] = effort[i]
            common.telemetry[ERROR, i] = reference.position[i] - position[i]
            common.telemetry[ERROR_RATE, i] = reference.velocity[i] - velocity[i]
        if before != NEVER:
            dt = (stamp - before) / NANOSECONDS
            numbers[SKIPPED] += (stamp - before) // timing.period - 1
        elif stamp != numbers[START]:  # the torque goes on from the one that acts
            vectors[TORQUE] = effort
            vectors[EXCESS] = 0.0
            numbers[TAKES_OVER] = 1
        numbers[LAST] = stamp
    last = Last(  # copies: a law may keep what it gets
        vectors[POSITION].copy(),
        vectors[REFERENCE].copy(),
        vectors[TORQUE].copy(),
        vectors[OFFSET].copy(),
        numbers[TAKES_OVER] != 0,
        numbers[KNOWN] != 0,
    )
    state = CycleState(
        vectors[POSE].copy(), last, vectors[EXCESS].copy(), vectors[HELD].copy(), numbers[FAULT]
    )
    return Question(code, stamp, known, before, fault, reference, position, velocity, state, dt)


@inner
def _close(
    common: Any, question: Question, done: Acted, acted: int, now: int, monotonic: int
) -> int:
    """Keep what a cycle did, write its command, and say what there is to tell."""
    v, numbers, after = common.vectors, common.numbers, done.state
    numbers[FAULT] = after.fault
    numbers[TAKES_OVER] = after.last.takes_over
    numbers[KNOWN] = after.last.known
    numbers[ACTED] |= done.acted
    for i in range(len(done.torque)):
        v[POSITION, i] = after.last.position[i]
        v[REFERENCE, i] = after.last.reference[i]
        v[TORQUE, i] = after.last.torque[i]
        v[OFFSET, i] = after.last.offset[i]
        v[EXCESS, i] = after.excess[i]
        v[HELD, i] = after.held[i]
        common.telemetry[COUPLED, i] = done.coupled_error[i]
        common.telemetry[SLIDING, i] = done.sliding_variable[i]
        common.torques[i] = done.torque[i]
    for i in range(len(after.pose)):
        v[POSE, i] = after.pose[i]
    stamp, before, period = question.stamp, question.before, common.timing.period
    common.log[numbers[LOGGED] % AGES, 0] = stamp
    common.log[numbers[LOGGED] % AGES, 1] = question.known
    numbers[LOGGED] += 1
    common.ages[numbers[ANSWERS] % AGES] = max(0, now - stamp)
    numbers[ANSWERS] += 1
    ended = numbers[END] != NEVER and stamp >= numbers[END]
    numbers[HEARD] = 0 if ended else monotonic
    index = stamp // period
    code = ANSWERED
    if index % SLOW == 0 or (before != NEVER and index // SLOW != before // period // SLOW):
        code |= TELEMETRY | LOG
    if ended or numbers[LOGGED] == AGES:
        code |= LOG
    if numbers[FAULT] != question.fault or numbers[ACTED] != acted:
        code |= STATUS
    return code
