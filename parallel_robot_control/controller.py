"""The controller without ROS: references and states in by stamp, torques out."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from parallel_robot_control import configuration, controller_state
from parallel_robot_control.answer_kernel import (
    ANSWERED,
    FOREVER,
    NEVER,
    NO_REFERENCE,
    OUT_OF_ORDER,
    REFUSED,
    REFUSED_LONG,
    STATUS,
    TELEMETRY,
    AnswerLog,
    Timing,
    common_of,
)
from parallel_robot_control.assembly_mode import AssemblyModes
from parallel_robot_control.configuration import ControlConfiguration, checked, preset_of
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import CycleState
from parallel_robot_control.estimation.lock_in import delay_text
from parallel_robot_control.law_core import STATE_FIELDS, LawCore, LawCores
from parallel_robot_control.messages import LOST, Status, message_layout
from parallel_robot_control.prepared_law import PreparedLaw
from parallel_robot_control.reference_buffer import (
    BACK,
    CONTRADICTS,
    LATE,
    RESTART,
    ReferenceBuffer,
)
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.clamped_efforts import ClampedEfforts
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import NANOSECONDS, OF_JOINTS, Array
from parallel_robot_model.compiler import need_compiler
from parallel_robot_model.configuration.hazard_table import REASONS, HazardTable
from parallel_robot_model.configuration.loop import OLDEST, WAIT
from parallel_robot_model.messages import cdr, layouts
from parallel_robot_model.messages.topics import Telemetry
from parallel_robot_model.robots.contract import Fault

NEARLY = NANOSECONDS // 10  # ns, by which the states of a run may begin late and end early
REFUSAL_TIMEOUT = NANOSECONDS // 10  # ns, for which all states are refused before that is a fault
REPEATED = NANOSECONDS // 4  # ns; a state repeated after this time was not a copy in the queue


class Controller:
    """Computes the torque of each state from the reference at the state's own stamp.

    :meth:`answer` is for messages of a known layout, :meth:`add_state` for numbers; both end
    in the same kernel.
    """

    def __init__(self, configuration: ControlConfiguration) -> None:
        """Prepare robot and laws.

        Args:
            configuration: The configuration.

        Raises:
            InputError: a law cannot be used, or the compiler is switched off.
        """
        need_compiler()
        self.configuration = configuration  # the present configuration
        self.counts: Counter[str] = Counter()  # number of unusual events by their description
        self._loop, joints = configuration.loop, configuration.loop.joints
        loop = self._loop
        self._faults = faults.of(configuration.robot.module)
        safety = configuration.safety
        self._state_timeout = round(safety.state_timeout * NANOSECONDS)
        self._heard = b''  # the last state
        self._references = ReferenceBuffer(loop.joints)
        self._common: Any = common_of(
            self._references.compiled,
            Timing(
                loop.period_ns,
                round(safety.reference_timeout * NANOSECONDS),
                self._state_timeout,
                round(safety.state_age * NANOSECONDS),
                loop.lockstep,
            ),
            len(joints),
        )
        self._lost = False  # whether the joint states went stale and none has come since
        self._fault_seen = faults.NONE  # the last fault counted
        self._refused = faults.NONE, 0, 0  # why, at which count of answers, since when [ns]
        self._changed = False  # whether law or fault changed since the last answer
        self._modes = AssemblyModes(configuration)
        self._offered: Array | None = None  # the pose that the user may confirm
        self._pose_text = ''  # the last pose that was reported, as text
        preset_of(configuration.loop)  # its files are read now, not while the robot moves
        self._units = configuration.robot.joint_units
        self._state_layout = layouts.joint_state(joints)
        self._own = message_layout(self._state_layout, STATE_FIELDS, range(len(joints)))
        self._states = self._own
        self.log = AnswerLog(self._common, loop.period_ns)  # log of the states that were answered
        self._pending: bytes | None = None  # a state that waits for its reference (lockstep)
        self._answered_at = 0  # ns, on the monotonic clock
        self._first: int | None = None  # stamp from which on the first torque of the run acted
        self._hazards = HazardTable(loop, safety.state_age)
        tolerance = np.broadcast_to(safety.effort_tolerance, len(joints)).tolist()
        self._efforts = ClampedEfforts(joints, tolerance, self._units)
        self._why = ''  # why the motors did not apply the torque, when that became a fault
        self._sample = -1  # of the last state that was received, for hazards
        self.command = b''  # the command message of the last answer
        self.code = 0  # what :func:`answer_kernel.answer` returned for the last state
        self._cores = LawCores(configuration, self._common, self._own)
        self._core = self._cores.make(configuration)
        self._state = self._cores.memory.state  # CycleState, which its functions change
        if loop.start_stamp == WAIT:
            self._common.first = FOREVER
        elif loop.start_stamp > 0:
            self.set_start(loop.start_stamp)
        elif loop.lockstep:
            self.set_start(loop.step_start)

    @property
    def law(self) -> PreparedLaw:
        """The active law."""
        return self._core.law

    @property
    def limits(self) -> SafetyParameters:
        """Limits that the kernels apply, see :func:`limiting.as_limits`."""
        limits: SafetyParameters = self._core.compiled.setup.safety.value
        return limits

    @property
    def pending(self) -> bool:
        """Whether a state waits for its reference (lockstep)."""
        return self._pending is not None

    @property
    def status(self) -> Status:
        """What the controller is doing."""
        delay = delay_text(self._core.compiled.setup, self._common.phase, self._units)
        fault = self._faults.get(self.fault)
        pose = LOST if self._state.lost else self._pose_text
        return Status(self.law.name, fault, self._common.active_limits, delay, pose)

    def explain(self, fault: Fault) -> Fault:
        """The present fault, with what is known of its cause."""
        if fault.key == faults.FAULTS[faults.TORQUE_LOST].key and self._why:
            return fault._replace(text=f'{fault.text}: {self._why}')
        return self.law.explain(fault)

    @property
    def joint_unit(self) -> dict[str, str]:
        """What diagnostics tell of the unit of the joints: nothing of hinges."""
        unit = self._units.of('rad')
        return {} if unit == 'rad' else {OF_JOINTS: unit}

    @property
    def fault(self) -> int:
        """NONE or the number of the present fault, see faults.py."""
        fault: int = self._state.fault
        return fault

    @property
    def state(self) -> CycleState:
        """State of the controller after the last cycle."""
        state: CycleState = self._state.value
        return state

    @property
    def stamp(self) -> int:
        """Stamp of the state answered last [ns]; 0 if there is none."""
        return max(0, self._common.last)

    @property
    def applied_stamp(self) -> int:
        """Stamp from which on the torque of the last answer acts [ns]; 0 if there is none."""
        return self.stamp + self._common.age

    @property
    def torque(self) -> Array:
        """Torque of the last answer [N m], shape (n,)."""
        torque: Array = self._common.torques.copy()
        return torque

    @property
    def telemetry(self) -> Telemetry:
        """Telemetry of the last answer, one row."""
        return Telemetry(*np.array(self._common.telemetry)[:, np.newaxis])

    def set_start(self, stamp: int) -> None:
        """Set the stamp of the state at which the motion starts [ns]: no take-over, so no ramp."""
        self._common.start = stamp
        self._common.first = stamp if self._loop.start_stamp == WAIT else 0
        if self._loop.last_index is not None:
            self._common.end = stamp + self._loop.last_index * self._loop.period_ns

    def trip(self, fault: int) -> None:
        """Enter a fault: the safe action begins with the next state."""
        if self.fault == faults.NONE:
            controller_state.trip(self._state, fault)
            self._count_fault()
            self._changed = True

    def refuse(self, fault: int) -> bool:
        """Leave out a state; enter a fault if all have been left out for long.

        Args:
            fault: Why it cannot be answered.

        Returns:
            Whether the states were lost since the last call: then the torque must be zero.
        """
        answers, now = self._common.answers, time.monotonic_ns()
        if self._refused[:2] != (fault, answers):
            self._refused = fault, answers, now
        return now - self._refused[2] > REFUSAL_TIMEOUT and self.lose(fault)

    def cause(self) -> int:
        """Fault whose cause is there now, else NONE: a fault is not cleared while it is."""
        refused, answers, _ = self._refused
        if refused != faults.NONE and answers == self._common.answers:
            return refused
        return faults.STATES_STALE if self.stale() else self._common.cause

    def set_pose(self, pose: Array) -> None:
        """Set the pose, shape (m,): the estimate follows it from there."""
        controller_state.set_pose(self._state, pose)
        self._offered, self._pose_text = None, ', '.join(map(repr, pose.tolist()))
        self._changed = True

    def confirm_pose(self) -> str:
        """Take the pose that :meth:`find_pose` named first.

        Returns:
            The reason why not; empty if the pose is known now.
        """
        if not self._state.lost:
            return 'the pose is known'
        if self._offered is None:
            return 'no pose was named; ~/clear_fault names those that fit the joint angles'
        self.set_pose(self._offered)
        return ''

    def pose_near(self, guess: Sequence[float]) -> Array:
        """The pose nearest to one that the user tells, shape (m,).

        Raises:
            InputError: the controller is not in a fault, or no pose there fits the joint angles.
        """
        key, near = 'controller.guess', np.array(checked(guess, self.configuration.robot))
        if self.fault == faults.NONE:
            raise InputError(f'{key} can be set in a fault alone', key)
        poses = self._modes.all(np.array(self._state.position), near)
        if not poses:
            raise InputError(f'{key}: no pose there fits the joint angles', key)
        return poses[0]

    def find_pose(self) -> str:
        """Find a pose that is lost by the passive joints.

        Returns:
            What the user has to do if they do not tell it; empty if the pose is known.
        """
        state = self._state
        if not state.lost:
            return ''
        position, pose = np.array(state.position), self._modes.by_passive_joints(self._heard)
        if pose is not None and self._modes.is_same_mode(self.configuration.guess, position, pose):
            self.set_pose(pose)
            return ''
        if pose is not None:
            self._offered = pose
            return (
                f'the robot is at {self._modes.text([pose])}, in another assembly mode than that '
                'in which its motion begins: move it back, or ~/confirm_pose to go on in this one'
            )
        poses = self._modes.all(position, np.array(state.pose))
        if not poses:
            return 'no pose fits the joint angles: move the robot away from the singularity'
        self._offered = poses[0]
        return (
            f'the pose is not known: the joint angles fit {self._modes.text(poses)}; '
            f'~/confirm_pose takes the first, controller.guess another'
        )

    def stale(self) -> bool:
        """Whether joint states were received but have stopped coming (wall time)."""
        answered_at = self._common.answer_time
        if not answered_at or self._loop.lockstep:
            return False
        return time.monotonic_ns() - answered_at > self._state_timeout

    def watch(self) -> bool:
        """Enter a fault if the joint states are stale.

        Returns:
            Whether they have become stale since the last call: then the torque must be zero.
        """
        return self.stale() and self.lose(self.cause())

    def lose(self, fault: int) -> bool:
        """Enter a fault because there are no joint states that can be trusted.

        Returns:
            Whether they were lost since the last call: then the torque must be zero.
        """
        if self._lost:
            return False
        self._lost = True
        self.trip(fault)
        controller_state.drop_torque(self._state)
        return True

    def waits(self) -> str:
        """Which reference is missing for long (lockstep); empty for none."""
        if self._pending is None or time.monotonic_ns() - self._answered_at < REPEATED:
            return ''
        stamp = (layouts.header_stamp(self._pending) or 0) / NANOSECONDS
        newest = f'{self._references.newest / NANOSECONDS} s' if len(self._references) else 'none'
        return f'the state of {stamp} s waits for its reference; the newest one: {newest}'

    def expect(self, layout: cdr.Layout, order: list[int]) -> None:
        """Let :meth:`answer` read messages of a layout; `order`: index of each joint in it."""
        self._states = message_layout(layout, STATE_FIELDS, order)

    def prepare_change(self, changes: Mapping[str, Any]) -> LawCore:
        """Prepare a change of law, gains or preset; :meth:`apply` makes it take effect.

        Args:
            changes: See :func:`configuration.changed`.

        Raises:
            UnknownNameError: no such key or law.
            InputError: a value is wrong, the theory of its law forbids the set of gains, or its
                process cannot start again.
        """
        changed = configuration.changed(self.configuration, changes)
        core = self._cores.make(changed)
        if core.law.foreign is not None:
            core.law.foreign.start()
        return core

    def apply(self, change: LawCore) -> None:
        """Make a change at the next state: the torque ramps from the last one to the new law's.

        See :func:`controller_state.switch`.
        """
        self.configuration, before = change.configuration, self._core
        if controller_state.same(before.law, change.law):
            return
        controller_state.switch(self._state, before.law, change.law)
        self._core = change
        self._changed = True

    def clear_fault(self) -> str:
        """Leave the fault if its cause is gone: empty memory, ramped torque, an approach.

        Returns:
            The reason why not; empty if there is no fault any more.
        """
        cause = self.cause()
        if cause != faults.NONE and self.fault != faults.NONE:
            return self._faults[cause].text
        unknown = self.find_pose()
        if unknown:
            return unknown
        if self.fault != faults.NONE:
            controller_state.clear(self._state)
            self._fault_seen = faults.NONE
            self.law.reset_memory()
        return ''

    def finish(self) -> bool:
        """Wait for a new run if this one is over: no fault that its states do not come any more.

        Returns:
            Whether it has come to the end of its ``duration`` since the last call.
        """
        last, first = self._loop.last_index, self._first
        if last is None or first is None or not self.stale():
            return False
        if abs(self.applied_stamp - first - last * self._loop.period_ns) > NEARLY:
            return False
        self._common.answer_time = 0
        self._reset()
        return True

    def read_reference(self, data: bytes) -> bool:
        """Take a reference message; False if it must go through :meth:`add_reference`."""
        return self._references.read(data)

    def add_reference(self, stamp: int, reference: JointReference) -> bool:
        """Take a reference sample, possibly out of order; answer a state that waits for it.

        Args:
            stamp: Stamp of the reference [ns].
            reference: Desired joint motion at the stamp.

        Returns:
            Whether a state was answered.
        """
        order = self._references.add(stamp, reference, self._loop.lockstep)
        if order in (LATE, CONTRADICTS):
            self.counts['reference stamps that repeat or go back'] += 1
            if order == CONTRADICTS:
                self.trip(faults.REFERENCES_DISAGREE)
            return False
        if order == BACK:
            self.counts['reference stamps that jump back'] += 1
        return self.answer_pending()

    def answer_pending(self) -> bool:
        """Answer a state that waits for its reference (lockstep); whether that has arrived."""
        return self._pending is not None and self.answer(self._pending, self._own) > 0

    def answer(self, data: bytes, wire: Any = None, now: int = 0) -> int:
        """Answer a state message.

        Args:
            data: The serialised message.
            wire: Layout of the message; None: the one given to :meth:`expect`.
            now: Time on the clock of the stamps [ns], to refuse old states; 0: accept any age.

        Returns:
            The code of :func:`answer_kernel.answer`; with ANSWERED, `command` is the answer.
        """
        states = self._states if wire is None else wire
        if self._hazards.on:
            self.code = self._apply_hazards(self._hazards, data)
            if self.code < 0:
                return self.code
        monotonic = time.monotonic_ns()
        code = self._cores.answer(self._core.compiled, states, data, now, monotonic)
        if code > 0:
            self.command = self._common.command.tobytes()
            self._pending, self._lost, self._answered_at = None, False, monotonic
            self._heard = data
            if self._first is None:
                self._first = self.applied_stamp
            if code != ANSWERED or self._changed:
                code |= STATUS if self._changed else 0
                self._changed = False
                self._count_fault()
                if code & TELEMETRY:
                    _, velocity, effort = self._common.measured
                    self._efforts.note(effort, self._common.torques, velocity)
        self.code = code
        return code

    def add_state(self, stamp: int, measured: Sequence[Array]) -> bool:
        """Answer a state that :meth:`answer` did not take, whatever its age.

        Args:
            stamp: Stamp of the state [ns].
            measured: Angles [rad], rates [rad/s] and torques [N m] at the stamp, each shape (n,).

        Returns:
            Whether it was answered.
        """
        common = self._common
        answered_at, common.answer_time = common.answer_time, 0  # it is answered, however late
        data = self._state_layout.encode(stamp, **dict(zip(STATE_FIELDS, measured, strict=True)))
        if self.answer(data, self._own) == OUT_OF_ORDER:
            last = common.last
            if stamp == last and not _equal(self._common.measured, map(np.nan_to_num, measured)):
                self.trip(faults.STATES_DISAGREE)
            if self._loop.lockstep and stamp == last:  # the plant asks again
                too_late = time.monotonic_ns() - self._answered_at > REPEATED
                self.code = ANSWERED if too_late else OUT_OF_ORDER
            elif not self._loop.lockstep and abs(stamp - last) < RESTART:
                self.counts['state stamps that repeat or go back'] += 1
            else:
                self.counts['new runs of the plant'] += 1
                self._reset()
                self.answer(data, self._own)
        if self.code == NO_REFERENCE and self._loop.lockstep:
            self._pending = data
        if self.code <= 0:
            common.answer_time = answered_at
        return self.code > 0

    def _apply_hazards(self, table: HazardTable, data: bytes) -> int:
        """Apply what hazards do to a controller before it answers a state."""
        common = self._common
        stamp, start = layouts.header_stamp(data), common.start
        if stamp is None or start == NEVER:
            return ANSWERED
        age = start - stamp if common.last == NEVER else common.age
        index = (stamp + (age if 0 < age <= OLDEST else 0) - start) // self._loop.period_ns
        before = self._sample if index > 0 else -1  # else the plant was reset
        sample = table.sample_of(index, before)
        self._sample = sample
        reason = faults.NUMBERS.get(REASONS[table.reception(sample).refused], faults.NONE)
        if reason != faults.NONE and self._loop.lockstep:
            self._refused = reason, common.answers, 0
        if any(before < renewal <= sample for renewal in table.renewals):
            self._state.fault = faults.NONE
            self._reset()
            self._fault_seen, self._changed = faults.NONE, True
        if any(before < clear <= sample for clear in table.clears):
            known = self.fault != faults.NONE and not self._state.lost
            self._changed |= known and not self.clear_fault()
        common.until = start + int(table.reception(index).newest) * self._loop.period_ns
        if reason == faults.NONE or not self._loop.lockstep:
            return ANSWERED
        return REFUSED_LONG if sample in table.lost and self.lose(reason) else REFUSED

    def _count_fault(self) -> None:
        """Count the present fault, once, by its text."""
        fault = self.fault
        if fault == self._fault_seen:
            return
        if fault == faults.TORQUE_LOST:
            self._why = self._efforts.warning()
        self._fault_seen = fault
        self.counts[self._faults[fault].text] += 1

    def _reset(self) -> None:
        controller_state.restart(self._state, np.array(self.configuration.guess))
        self.law.reset_memory()
        self._common.active_limits, self._common.cause = 0, faults.NONE
        self._common.last = NEVER
        self._pending = self._first = None


def _equal(some: Iterable[Array], others: Iterable[Array]) -> bool:
    return all(map(np.array_equal, some, others))
