"""State of a controller between two cycles: when the motion starts, faults, lost joint states."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_control.answer_kernel import FOREVER, Timing, common_of
from parallel_robot_control.approach import BACK
from parallel_robot_control.assembly_mode import AssemblyModes
from parallel_robot_control.configuration import ControlConfiguration, checked
from parallel_robot_control.cycle import CycleState, initial_state
from parallel_robot_control.messages import Telemetry
from parallel_robot_control.prepared_law import PreparedLaw
from parallel_robot_control.reference_buffer import ReferenceBuffer
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import need_compiler, vector
from parallel_robot_model.configuration.loop import WAIT

# What happens to a controller between two cycles: faults, clearing, switching, a new run.
#
# The live controller and the replay of a bag both use these, so they cannot disagree.


def joining(state: CycleState, torque: Array) -> CycleState:
    """Let the law begin anew: torque as of :func:`taking_over`, an approach from where it is."""
    return taking_over(state, torque)._replace(begins=BACK)


def taking_over(state: CycleState, torque: Array) -> CycleState:
    """Let the next torque continue from `torque` [N m], shape (n,); from 0 if not finite."""
    known = vector(np.where(np.isfinite(torque), torque, 0.0))
    return state._replace(
        last=state.last._replace(torque=known, takes_over=True), excess=vector(0.0 * known)
    )


def rejoined(state: CycleState) -> CycleState:
    """References are there again: an approach to them, torque from the last one."""
    return joining(state, state.last.torque)


def tripped(state: CycleState, fault: int) -> CycleState:
    """Enter a fault, unless the controller already is in one."""
    if state.fault != faults.NONE:
        return state
    return state._replace(fault=fault, held=state.last.position)


def without_torque(state: CycleState) -> CycleState:
    """The state after zero torque was sent because no joint states can be trusted."""
    return state._replace(last=state.last._replace(torque=vector(np.zeros(len(state.held)))))


def cleared(state: CycleState) -> CycleState:
    """Leave a fault: an empty memory of the law, torque from the last one, a new approach."""
    if state.fault == faults.NONE:
        return state
    return joining(state, state.last.torque)._replace(fault=faults.NONE)


def placed(state: CycleState, pose: Array) -> CycleState:
    """Know the pose, shape (m,), or one near it on the same assembly mode."""
    return state._replace(pose=vector(pose), lost=False)


def same(before: PreparedLaw, after: PreparedLaw) -> bool:
    """Whether a change of law and gains changes nothing."""
    return bool((after.name, after.gains) == (before.name, before.gains))


def switched(state: CycleState, before: PreparedLaw, after: PreparedLaw) -> CycleState:
    """Change law or gains; the torque continues from the last one, if there is one.

    A law that becomes active starts with an empty memory; new gains of the active law keep its
    memory.

    Args:
        state: State of the controller.
        before: The previous law.
        after: The law from now on; its memory is made what it then is.
    """
    if after.name != before.name:
        after.reset_memory()
    elif after.memory is not before.memory:
        after.memory.current = before.memory.current
    if state.last.known and not same(before, after):
        state = taking_over(state, state.last.torque)
    return state


def restarted(state: CycleState, guess: Array) -> CycleState:
    """The state before a new run of the plant; a fault, and a pose that is lost, stay so.

    `guess`: its pose, shape (m,).
    """
    begun = initial_state(guess, len(state.held))
    return begun._replace(fault=state.fault, lost=state.lost)


REFUSAL_TIMEOUT = NANOSECONDS // 10  # ns, for which all states are refused before that is a fault


class ControllerState:
    """State of a controller between two cycles, in what its kernels share."""

    def __init__(self, configuration: ControlConfiguration) -> None:
        """Begin without a fault, before the first state.

        Raises:
            InputError: the compiler is switched off.
        """
        need_compiler()
        self.configuration = configuration  # the present configuration
        self.counts: Counter[str] = Counter()  # number of unusual events by their description
        self._loop = loop = configuration.loop
        self._faults = faults.of(configuration.robot.module)
        safety = configuration.safety
        self._state_timeout = round(safety.state_timeout * NANOSECONDS)
        self._heard = b''  # the last state
        self._references = ReferenceBuffer(loop.joints)
        state = initial_state(np.array(configuration.guess), len(loop.joints))
        self._common: Any = common_of(
            self._references.compiled,
            Timing(
                loop.period_ns,
                round(safety.reference_timeout * NANOSECONDS),
                self._state_timeout,
                round(safety.state_age * NANOSECONDS),
                loop.lockstep,
            ),
            state,
        )
        self._lost = False  # whether the joint states went stale and none has come since
        self._fault_seen = faults.NONE  # the last fault counted
        self._refused = faults.NONE, 0, 0  # why, at which count of answers, since when [ns]
        self._changed = False  # whether law or fault changed since the last answer
        self._modes = AssemblyModes(configuration)
        self._offered: Array | None = None  # the pose that the user may confirm
        self._told = ''  # the last pose that was told
        if loop.start_stamp == WAIT:
            self._common.first = FOREVER
        elif loop.start_stamp > 0:
            self.begin(loop.start_stamp)
        elif loop.lockstep:
            self.begin(loop.step_start)
        if configuration.stopped:
            self.trip(faults.EMERGENCY_STOP)

    @property
    def fault(self) -> int:
        """NONE or the number of the present fault, see faults.py."""
        fault: int = self._common.state.fault
        return fault

    @property
    def state(self) -> CycleState:
        """State of the controller after the last cycle."""
        state: CycleState = self._common.state.value
        return state

    @property
    def stamp(self) -> int:
        """Stamp of the state answered last [ns]; 0 if there is none."""
        return max(0, self._common.last)

    @property
    def acts(self) -> int:
        """Stamp from which on the torque of the last answer acts [ns]; 0 if there is none."""
        return self.stamp + self._common.age

    @property
    def telemetry(self) -> Telemetry:
        """Telemetry of the last answer, one row."""
        return Telemetry(*self._common.telemetry[:, np.newaxis].copy())

    def begin(self, stamp: int) -> None:
        """Set the stamp of the state at which the motion starts [ns]: no take-over, so no ramp."""
        self._common.start = stamp
        self._common.first = stamp if self._loop.start_stamp == WAIT else 0
        if self._loop.last_index is not None:
            self._common.end = stamp + self._loop.last_index * self._loop.period_ns

    def trip(self, fault: int) -> None:
        """Enter a fault: the safe action begins with the next state."""
        if self.fault == faults.NONE:
            self._store(tripped(self.state, fault))
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

    def place(self, pose: Array) -> None:
        """Know the pose again, shape (m,): the estimate follows it from there."""
        self._store(placed(self.state, pose))
        self._offered, self._told = None, ', '.join(map(repr, pose.tolist()))
        self._changed = True

    def confirm_pose(self) -> str:
        """Take the pose that :meth:`find_pose` named first.

        Returns:
            The reason why not; empty if the pose is known now.
        """
        if not self._common.state.lost:
            return 'the pose is known'
        if self._offered is None:
            return 'no pose was named; ~/clear_fault names those that fit the joint angles'
        self.place(self._offered)
        return ''

    def pose_near(self, guess: Sequence[float]) -> Array:
        """The pose nearest to one that the user tells, shape (m,).

        Raises:
            InputError: the controller is not in a fault, or no pose there fits the joint angles.
        """
        key, near = 'controller.guess', np.array(checked(guess, self.configuration.robot))
        if self.fault == faults.NONE:
            raise InputError(f'{key} can be set in a fault alone', key)
        poses = self._modes.all(np.array(self.state.last.position), near)
        if not poses:
            raise InputError(f'{key}: no pose there fits the joint angles', key)
        return poses[0]

    def find_pose(self) -> str:
        """Find a pose that is lost by the passive joints.

        Returns:
            What the user has to do if they do not tell it; empty if the pose is known.
        """
        state = self.state
        if not state.lost:
            return ''
        position, pose = np.array(state.last.position), self._modes.by_passive_joints(self._heard)
        if pose is not None and self._modes.is_as(self.configuration.guess, position, pose):
            self.place(pose)
            return ''
        if pose is not None:
            self._offered = pose
            return (
                f'the robot is at {self._modes.told([pose])}, in another assembly mode than that '
                'in which its motion begins: move it back, or ~/confirm_pose to go on in this one'
            )
        poses = self._modes.all(position, np.array(state.pose))
        if not poses:
            return 'no pose fits the joint angles: move the robot away from the singularity'
        self._offered = poses[0]
        return (
            f'the pose is not known: the joint angles fit {self._modes.told(poses)}; '
            f'~/confirm_pose takes the first, controller.guess another'
        )

    def stale(self) -> bool:
        """Whether joint states were received but have stopped coming (wall time)."""
        heard = self._common.heard
        if not heard or self._loop.lockstep:
            return False
        return time.monotonic_ns() - heard > self._state_timeout

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
        self._store(without_torque(self.state))
        return True

    def _store(self, state: CycleState) -> None:
        self._common.state.value = state

    def _count_fault(self) -> None:
        """Count the present fault, once, by its text."""
        fault = self.fault
        if fault != self._fault_seen:
            self._fault_seen = fault
            self.counts[self._faults[fault].text] += 1
