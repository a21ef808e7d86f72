"""The controller without ROS: references and states in by stamp, torques out."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base import cache_directory, cdr, config
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_base.fields import Field, parameters
from parallel_robot_base.kernel import entry_point
from parallel_robot_base.loop import STEP_START, WAIT, LoopParameters
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import answering, faults
from parallel_robot_control.answering import (
    ACTED,
    AGES,
    ANSWERED,
    ANSWERS,
    END,
    FAULT,
    FROM,
    HEARD,
    LAST,
    LOGGED,
    MEASURED,
    NEVER,
    NO_REFERENCE,
    OUT_OF_ORDER,
    RESTART,
    SKIPPED,
    START,
    STATUS,
    LawCore,
    Timing,
)
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import CycleState, initial_state, taking_over
from parallel_robot_control.faults import FAULT_TEXT
from parallel_robot_control.laws import LAWS, PreparedLaw, available, judged, prepare
from parallel_robot_control.messages import Status, Telemetry, answers_message
from parallel_robot_control.reference_buffer import ReferenceBuffer, append_message
from parallel_robot_control.safety import SafetyParameters, limits_of
from parallel_robot_control.wire import wire_of
from parallel_robot_model.planar_3rrr.parameters import RobotParameters, validate
from trajectory_gen.trajectory import Trajectory

Array = NDArray[np.float64]

LOST = NANOSECONDS // 4  # ns, after which a state that comes again was not a copy in the queue
FOREVER = 2**63 - 1  # ns
STATE_FIELDS = ('position', 'velocity', 'effort')
REFERENCE_FIELDS = ('position', 'velocity', 'acceleration')


class ControllerParameters(NamedTuple):
    """What the controller needs beside robot and law."""

    guess: Annotated[
        tuple[float, ...],
        Field('m, m, rad', 'pose from which the first forward kinematics starts'),
    ]


def first_guess(values: Mapping[str, Any]) -> list[float]:
    """The parameter ``controller.guess``, or the first pose of the scenario's trajectory.

    Raises:
        InputError: the parameter is not a pose.
    """
    given = list(config.group(values, ControllerParameters, 'controller').guess)
    if len(given) not in (0, 3):
        raise InputError(f'controller.guess must be empty or [x, y, phi], not {given}')
    return given or Trajectory.of(values).sample(0.0).pose[0].tolist()


class JointSample(NamedTuple):
    """Measured joints at one time: [rad], [rad/s], [N m], each shape (n,)."""

    position: Array
    velocity: Array
    effort: Array


class Sample(NamedTuple):
    """Answer to one state: the torque [N m], shape (n,), and what there is to tell of it."""

    torque: Array
    telemetry: Telemetry
    status: Status


class Change(NamedTuple):
    """A change of law or gains that was found good: the new configuration, the law compiled."""

    values: dict[str, Any]
    core: LawCore

    @property
    def law(self) -> PreparedLaw:
        """The law."""
        return self.core.law


class Controller:
    """Computes the torque of each state from the reference at the state's own stamp.

    :meth:`answer` is for messages whose layout is known, :meth:`add_state` for numbers; both end
    in the same kernel.

    Attributes:
        counts: How often something unusual happened, by its description.
        command: The command message of the last answer.
        code: What became of the last state, as of :func:`answering.answer`.
    """

    def __init__(self, values: Mapping[str, Any], lazy: bool = False) -> None:
        """Prepare robot, laws and first guess from a resolved configuration.

        Args:
            values: The configuration.
            lazy: Whether laws that are compiled, but not active, are left to :meth:`load`.

        Raises:
            InputError: a value is wrong.
        """
        self._values = dict(values)
        self._loop = config.group(values, LoopParameters, '')
        self._robot = validate(config.group(values, RobotParameters, 'robot'))
        self._guess = np.array(first_guess(values))
        safety = config.group(values, SafetyParameters, 'safety')
        self._limits = limits_of(safety)
        self._timing = Timing(
            self._loop.period_ns,
            round(safety.reference_timeout * NANOSECONDS),
            round(safety.state_timeout * NANOSECONDS),
            self._loop.lockstep,
        )
        self._preset = _typed(values, config.preset(values['own_laws']))
        self.counts: Counter[str] = Counter()
        joints = self._loop.joints
        self._references = ReferenceBuffer(len(joints))
        self._state_layout = cdr.joint_state(joints)
        self._reference_layout = cdr.joint_trajectory(joints)
        self._own = wire_of(self._state_layout, STATE_FIELDS, range(len(joints)))
        self._states = self._own
        self._reference_wire = wire_of(
            self._reference_layout, REFERENCE_FIELDS, range(len(joints))
        )
        self._append = entry_point(
            append_message, self._references.compiled, self._reference_wire, b''
        )
        self._arrays = answering.shared(self._guess, len(joints))
        self._numbers = self._arrays.numbers
        self._common = answering.common(self._references.compiled, self._timing, self._arrays)
        self._pending: bytes | None = None  # a state that waits for its reference (lockstep)
        self._answered_at = 0  # ns, on the clock that never jumps
        self._ages_taken = 0
        self._lost = False  # whether the joint states were found stale, and none came since
        self._fault_seen = faults.NONE  # the fault that was counted last
        self._changed = False  # whether law or fault are new since the last answer
        self.command = b''
        self.code = 0
        if self._loop.start_stamp == WAIT:
            self._numbers[FROM] = FOREVER
        elif self._loop.start_stamp > 0:
            self.begin(self._loop.start_stamp)
        elif self._loop.lockstep:
            self.begin(STEP_START)
        self._loading = threading.Lock()
        active = str(values['law'])
        self._core = self._compiled(active, values)
        later = (
            set(LAWS)
            if lazy and cache_directory.marked(cache_directory.COMPLETE) is not None
            else set()
        )
        self._unloaded = [name for name in LAWS if name in later and name != active]
        for name in available(values):  # compiled now, not at a switch
            judged(name, values)
            if name not in (active, *later):
                self._compiled(name, values)
        if not later:
            cache_directory.mark(cache_directory.COMPLETE)

    def load(self) -> bool:
        """Load a law that was left out; for a thread beside the loop.

        Returns:
            Whether there are more.
        """
        if self._unloaded:
            self._compiled(self._unloaded.pop(), self._values)
        return bool(self._unloaded)

    @property
    def law(self) -> PreparedLaw:
        """The active law."""
        return self._core.law

    @property
    def fault(self) -> int:
        """NONE or the key of FAULT_TEXT of the fault that the controller is in."""
        return int(self._numbers[FAULT])

    @property
    def state(self) -> CycleState:
        """What the last cycle handed on."""
        return answering.stored(self._arrays)

    @property
    def memory(self) -> Any:
        """What the law remembers."""
        return self._core.memory

    @property
    def stamp(self) -> int:
        """Stamp of the state that was answered last [ns]; 0: there is none."""
        return max(0, int(self._numbers[LAST]))

    @property
    def telemetry(self) -> Telemetry:
        """What there is to tell of the last answer; one row."""
        return Telemetry(*self._arrays.telemetry[:, np.newaxis].copy())

    @property
    def pending(self) -> bool:
        """Whether a state waits for its reference (lockstep)."""
        return self._pending is not None

    @property
    def status(self) -> Status:
        """What the controller is doing."""
        return Status(self.law.name, self.fault, int(self._numbers[ACTED]))

    def begin(self, stamp: int) -> None:
        """Tell that the motion starts at a state [ns]: no take-over, so no ramp."""
        self._numbers[START] = stamp
        self._numbers[FROM] = stamp if self._loop.start_stamp == WAIT else 0
        if self._loop.samples is not None:
            self._numbers[END] = stamp + self._loop.samples * self._loop.period_ns

    def expect(self, layout: cdr.Layout, order: list[int]) -> None:
        """Let :meth:`answer` read state messages of a layout; `order`: its joints, as ours."""
        self._states = wire_of(layout, STATE_FIELDS, order)

    def judge(self, changes: Mapping[str, Any]) -> Change:
        """Look whether a change of law, gains or preset is good; it takes effect by :meth:`apply`.

        Args:
            changes: Key to value: ``law``, ``preset``, or ``<law>.<gain>``. ``preset: paper`` is
                for all gains.

        Raises:
            UnknownNameError: no such key or law.
            InputError: a value is wrong, or the theory of its law forbids the set of gains.
        """
        gains = self._preset
        known = {'law', 'preset', *gains}
        for key in changes:
            if key not in known:
                raise UnknownNameError('parameter', key, known)
        values = self._values | (gains if changes.get('preset') == config.PRESET else {})
        values |= changes
        same = all(values[key] == value for key, value in gains.items())
        values['preset'] = config.PRESET if same else 'custom'
        if changes.get('preset', values['preset']) != values['preset']:
            raise InputError(
                f'preset is {values["preset"]} with these gains, not {changes["preset"]!r}'
            )
        touched = {key.partition('.')[0] for key in changes} - {'law', 'preset'}
        for name in touched:
            _, gains, _ = judged(name, values)
            keys = [f'{name}.{parameter.key}' for parameter in parameters(type(gains))]
            values |= dict(zip(keys, gains, strict=True))  # 12 becomes 12.0
        return Change(values, self._compiled(str(values['law']), values))

    def apply(self, change: Change) -> None:
        """Make a change at the next state: the torque ramps from the last one to the new law's.

        A law that becomes active starts with an empty memory; new gains of the active law go on
        with the memory that it has.
        """
        self._values = change.values
        before, after = self.law, change.law
        if (after.name, after.gains) == (before.name, before.gains):
            return
        if after.name == before.name:
            change.core.memory = self._core.memory
        self._core = change.core
        self._changed = True
        if self._numbers[LAST] != NEVER:
            self._go_on()

    def trip(self, fault: int) -> None:
        """Enter a fault: the safe action begins with the next state."""
        if self.fault == faults.NONE:
            state = self.state
            self._store(state._replace(fault=fault, held=state.last.position))
            self._count_fault()
            self._changed = True

    def clear_fault(self) -> str:
        """Leave the fault, if its cause is gone, with an empty memory and ramped torque.

        Returns:
            Why not; empty when there is no fault any more.
        """
        if self.stale():
            return FAULT_TEXT[faults.STATES_STALE]
        if self.fault != faults.NONE:
            self._go_on()
            self._numbers[FAULT] = self._fault_seen = faults.NONE
            self._core.memory = self.law.memory
        return ''

    def stale(self) -> bool:
        """Whether joint states came, and come no more (wall time)."""
        heard = int(self._numbers[HEARD])
        if not heard or self._loop.lockstep:
            return False
        return time.monotonic_ns() - heard > self._timing.state_timeout

    def watch(self) -> bool:
        """Enter a fault when the joint states are stale.

        Returns:
            Whether they are since the last call: then the torque has to be zero.
        """
        return self.stale() and self.lose(faults.STATES_STALE)

    def lose(self, fault: int) -> bool:
        """Enter a fault because there are no joint states that can be trusted.

        Returns:
            Whether they are lost since the last call: then the torque has to be zero.
        """
        if self._lost:
            return False
        self._lost = True
        self.trip(fault)
        state = self.state
        zero = np.zeros(len(state.last.torque))
        self._store(state._replace(last=state.last._replace(torque=zero)))
        return True

    def zero_command(self) -> bytes:
        """A command of zero torque that answers no state; it stands in the log as such."""
        self._arrays.log[self._numbers[LOGGED] % AGES] = 0
        self._numbers[LOGGED] += 1
        return cdr.float64_multi_array(len(self._loop.joints)).template.tobytes()

    def take_log(self) -> bytes:
        """Message of ``controller/answered``: which states were answered since the last call."""
        count = min(int(self._numbers[LOGGED]), AGES)
        self._numbers[LOGGED] = 0
        return answers_message(self._arrays.log[:count])

    def take_ages(self) -> Array:
        """Ages of the states answered since the last call, of the newest AGES at most [s]."""
        rows = np.arange(max(self._ages_taken, self.answered - AGES), self.answered) % AGES
        self._ages_taken = self.answered
        return self._arrays.ages[rows] / NANOSECONDS

    @property
    def answered(self) -> int:
        """How many states were answered."""
        return int(self._numbers[ANSWERS])

    @property
    def skipped(self) -> int:
        """How many states were not, because a newer one was there or they never came."""
        return int(self._numbers[SKIPPED])

    def read_reference(self, data: bytes) -> bool:
        """Take a reference message; False when it is for :meth:`add_reference` to judge."""
        return bool(self._append(self._references.compiled, self._reference_wire, data))

    def add_reference(self, stamp: int, reference: JointReference) -> Sample | None:
        """Take a reference sample that is perhaps not in order; answer a state that waits for it.

        Args:
            stamp: [ns].
            reference: Desired joint motion at the stamp.
        """
        references = self._references
        if len(references) and stamp <= references.newest:
            if not self._loop.lockstep and references.newest - stamp < RESTART:
                self.counts['reference stamps that repeat or go back'] += 1
                known = references.at(stamp)
                if known is not None and not _equal(known, reference):
                    self.trip(faults.REFERENCES_DISAGREE)
                return None
            if not self._loop.lockstep:
                self.counts['reference stamps that jump back'] += 1
            references.drop_since(stamp)  # they were wrong, or of another run
        references.append(stamp, reference)
        return self.answer_pending()

    def answer_pending(self) -> Sample | None:
        """Answer a state that waits for its reference (lockstep), if it is here now."""
        if self._pending is None or self.answer(self._pending, self._own) <= 0:
            return None
        return self._sample()

    def answer(self, data: bytes, wire: Any = None, now: int = 0) -> int:
        """Answer a state message.

        Args:
            data: The message.
            wire: Of the message; None: that of :meth:`expect`.
            now: Time on the clock of the stamps, for which a state may be too old [ns]; 0: any.

        Returns:
            What :func:`answering.answer` returns; with ANSWERED, `command` is the answer.
        """
        states = self._states if wire is None else wire
        monotonic = time.monotonic_ns()
        code = self._core.answer(states, data, now, monotonic)
        if code > 0:
            self.command = self._arrays.command.tobytes()
            self._pending, self._lost, self._answered_at = None, False, monotonic
            if code != ANSWERED or self._changed:
                code |= STATUS if self._changed else 0
                self._changed = False
                self._count_fault()
        self.code = code
        return code

    def add_state(self, stamp: int, measured: JointSample) -> Sample | None:
        """Answer a state that :meth:`answer` did not take, whatever its age.

        Args:
            stamp: [ns].
            measured: Joints at the stamp.
        """
        numbers = self._numbers
        heard, numbers[HEARD] = int(numbers[HEARD]), 0  # it is answered however late it is
        data = self._state_layout.encode(stamp, **measured._asdict())
        if self.answer(data, self._own) == OUT_OF_ORDER:
            last = int(numbers[LAST])
            if stamp == last and not _equal(self._arrays.vectors[MEASURED], measured):
                self.trip(faults.STATES_DISAGREE)
            if self._loop.lockstep and stamp == last:  # the plant asks again
                lost = time.monotonic_ns() - self._answered_at > LOST
                self.code = ANSWERED if lost else OUT_OF_ORDER
            elif not self._loop.lockstep and abs(stamp - last) < RESTART:
                self.counts['state stamps that repeat or go back'] += 1
            else:
                self.counts['new runs of the plant'] += 1
                self._reset()
                self.answer(data, self._own)
        if self.code == NO_REFERENCE and self._loop.lockstep:
            self._pending = data
        if self.code <= 0:
            numbers[HEARD] = heard
        return self._sample() if self.code > 0 else None

    def _sample(self) -> Sample:
        return Sample(self._arrays.torques.copy(), self.telemetry, self.status)

    def _compiled(self, name: str, values: Mapping[str, Any]) -> LawCore:
        with self._loading:
            law = prepare(name, values)
            return LawCore(law, self._robot, self._limits, self._common, self._own)

    def _store(self, state: CycleState) -> None:
        answering.store(self._arrays, state)

    def _go_on(self) -> None:
        """Let the next torque go on from the last one."""
        state = self.state
        self._store(taking_over(state, state.last.torque))

    def _count_fault(self) -> None:
        if self.fault != self._fault_seen:
            self._fault_seen = self.fault
            self.counts[FAULT_TEXT[self.fault]] += 1

    def _reset(self) -> None:
        self._store(initial_state(self._guess)._replace(fault=self.fault))
        self._core.memory = self.law.memory
        self._numbers[ACTED] = 0
        self._numbers[LAST] = NEVER
        self._pending = None


def _typed(values: Mapping[str, Any], gains: Mapping[str, Any]) -> dict[str, Any]:
    """Gains of all laws as the laws take them: 12 becomes 12.0."""
    typed: dict[str, Any] = {}
    for name, law in available(values).items():
        of_law = config.group(gains, law.Gains, name)
        keys = (f'{name}.{parameter.key}' for parameter in parameters(law.Gains))
        typed |= dict(zip(keys, of_law, strict=True))
    return typed


def _equal(some: Iterable[Array], others: Iterable[Array]) -> bool:
    return all(map(np.array_equal, some, others))
