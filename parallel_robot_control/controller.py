"""The controller without ROS: references and states in by stamp, torques out."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Mapping
from contextlib import nullcontext
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control import faults
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import Cycle, initial_state, run_cycle, taking_over
from parallel_robot_control.faults import FAULT_TEXT
from parallel_robot_control.laws import LAWS, PreparedLaw, available, prepare
from parallel_robot_control.messages import Status, Telemetry
from parallel_robot_control.safety import SafetyParameters, limits_of
from parallel_robot_interface import config
from parallel_robot_interface.cdr import NANOSECONDS
from parallel_robot_interface.errors import InputError, UnknownNameError
from parallel_robot_interface.fields import Field, parameters
from parallel_robot_interface.loop import STEP_START, LoopParameters
from parallel_robot_model.kernel import in_memory
from parallel_robot_model.parameters import RobotParameters, validate
from trajectory_gen.trajectory import Trajectory

Array = NDArray[np.float64]

LOST = 0.25  # s, after which a state that comes again was not a copy in the queue
RESTART = NANOSECONDS // 2  # a jump of the stamps by more than this is a new run of the plant


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
    """A change of law or gains that was found good: the new configuration and its law."""

    values: dict[str, Any]
    law: PreparedLaw


class Controller:
    """Computes the torque of each state from the reference at the state's own stamp.

    Attributes:
        law: The active law.
        counts: How often something unusual happened, by its description.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Prepare robot, laws and first guess from a resolved configuration.

        Raises:
            InputError: a value is wrong.
        """
        self._values = dict(values)
        self._loop = config.group(values, LoopParameters, '')
        self._robot = validate(config.group(values, RobotParameters, 'robot'))
        self._guess = np.array(first_guess(values))
        safety = config.group(values, SafetyParameters, 'safety')
        self._limits = limits_of(safety)
        self._state_timeout = safety.state_timeout
        self._reference_timeout = round(safety.reference_timeout * NANOSECONDS)
        self.law = prepare(self._loop.law, values)
        self._preset = _typed(values, config.preset(values['own_laws']))
        self.counts: Counter[str] = Counter()
        self._references: deque[tuple[int, JointReference]] = deque(maxlen=10_000)
        self._pending: tuple[int, JointSample] | None = None
        self._sample: Sample | None = None  # answer to the last state
        self._answered_at = 0.0
        self._heard_at: float | None = None  # when the last state came; None: none or the end
        self._last: int | None = None
        self._lost = False  # whether the joint states were found stale, and none came since
        self._start: int | None = self._loop.start_stamp if self._loop.start_stamp > 0 else None
        if self._loop.lockstep and self._loop.start_stamp == 0:
            self._start = STEP_START
        self._input: JointSample | None = None  # the last state
        self._acted = 0
        self._state = initial_state(self._guess)
        self._memory = self.law.memory
        for name in available(values):  # compiled now, not at a switch
            law = self.law if name == self.law.name else prepare(name, values)
            with in_memory(run_cycle) if name not in LAWS else nullcontext():
                self._cycle(law, _RESTING, _STILL, law.memory, self._loop.period)

    @property
    def fault(self) -> int:
        """NONE or the key of FAULT_TEXT of the fault that the controller is in."""
        return int(self._state.fault)

    def begin(self, stamp: int) -> None:
        """Tell that the motion starts at a state [ns]: no take-over, so no ramp."""
        self._start = stamp

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
            law = prepare(name, values)
            keys = [f'{name}.{parameter.key}' for parameter in parameters(type(law.gains))]
            values |= dict(zip(keys, law.gains, strict=True))  # 12 becomes 12.0
        return Change(values, prepare(str(values['law']), values))

    def apply(self, change: Change) -> None:
        """Make a change at the next state: the torque ramps from the last one to the new law's.

        A law that becomes active starts with an empty memory; new gains of the active law go on
        with the memory that it has.
        """
        active = (self.law.name, self.law.gains)
        same = change.law.name == self.law.name
        self._values, self.law = change.values, change.law
        if (self.law.name, self.law.gains) == active:
            return
        if not same:
            self._memory = self.law.memory
        if self._last is not None:
            self._state = taking_over(self._state, self._state.last.torque)

    def trip(self, fault: int) -> None:
        """Enter a fault: the safe action begins with the next state."""
        if self._state.fault == faults.NONE:
            held = self._state.last.position
            self._state = self._state._replace(fault=fault, held=held)
            self.counts[FAULT_TEXT[fault]] += 1

    def clear_fault(self) -> str:
        """Leave the fault, if its cause is gone, with an empty memory and ramped torque.

        Returns:
            Why not; empty when there is no fault any more.
        """
        if self.stale():
            return FAULT_TEXT[faults.STATES_STALE]
        if self._state.fault != faults.NONE:
            ramped = taking_over(self._state, self._state.last.torque)
            self._state = ramped._replace(fault=faults.NONE)
            self._memory = self.law.memory
        return ''

    def stale(self) -> bool:
        """Whether joint states came, and come no more (wall time)."""
        if self._heard_at is None or self._loop.lockstep:
            return False
        return time.monotonic() - self._heard_at > self._state_timeout

    def watch(self) -> bool:
        """Enter a fault when the joint states are stale.

        Returns:
            Whether they are since the last call: then no torque is right for states nobody knows.
        """
        return self.stale() and self.lose(faults.STATES_STALE)

    def lose(self, fault: int) -> bool:
        """Enter a fault for want of joint states that can be believed.

        Returns:
            Whether they are lost since the last call: then no torque is right.
        """
        if self._lost:
            return False
        self._lost = True
        self.trip(fault)
        zero = np.zeros(len(self._state.last.torque))
        self._state = self._state._replace(last=self._state.last._replace(torque=zero))
        return True

    def add_reference(self, stamp: int, reference: JointReference) -> Sample | None:
        """Take a reference sample; answer a state that waited for it.

        Args:
            stamp: [ns].
            reference: Desired joint motion at the stamp.
        """
        if self._references and stamp <= self._references[-1][0]:
            back = self._references[-1][0] - stamp
            if not self._loop.lockstep and back < RESTART:
                self.counts['reference stamps that repeat or go back'] += 1
                known = next((old for at, old in reversed(self._references) if at == stamp), None)
                if known is not None and not _equal(known, reference):
                    self.trip(faults.REFERENCES_DISAGREE)
                return None
            if not self._loop.lockstep:
                self.counts['reference stamps that jump back'] += 1
            while self._references and self._references[-1][0] >= stamp:
                self._references.pop()  # the later ones, which were wrong or of another run
        self._references.append((stamp, reference))
        if self._pending is not None:
            return self._answer(*self._pending)
        return None

    def add_state(self, stamp: int, measured: JointSample) -> Sample | None:
        """Take a state; answer it when there is a reference for it.

        Args:
            stamp: [ns].
            measured: Joints at the stamp.
        """
        if self._last is not None and not 0 < stamp - self._last < RESTART:
            if stamp == self._last and not _equal(self._input, measured):
                self.trip(faults.STATES_DISAGREE)
            if self._loop.lockstep and stamp == self._last:
                lost = time.monotonic() - self._answered_at > LOST
                return self._sample if lost else None  # the plant asks again
            if not self._loop.lockstep and abs(stamp - self._last) < RESTART:
                self.counts['state stamps that repeat or go back'] += 1
                return None
            self.counts['new runs of the plant'] += 1
            self._reset()
        return self._answer(stamp, measured)

    def _answer(self, stamp: int, measured: JointSample) -> Sample | None:
        reference = self._reference_at(stamp)
        self._pending = None
        if reference is None:
            self._pending = (stamp, measured) if self._loop.lockstep else None
            return None
        dt = self._loop.period if self._last is None else (stamp - self._last) / NANOSECONDS
        if self._last is None and stamp != self._start:
            self._state = taking_over(self._state, measured.effort)
        self._last, self._input = stamp, measured
        before = self._state.fault
        cycle = self._cycle(self.law, reference, measured, self._memory, dt)
        self._state, self._memory = cycle.state, cycle.memory
        if self._state.fault != before:
            self.counts[FAULT_TEXT[self._state.fault]] += 1
        self._acted |= cycle.acted
        telemetry = Telemetry(
            (reference.position - measured.position)[np.newaxis],
            (reference.velocity - measured.velocity)[np.newaxis],
            cycle.coupled_error[np.newaxis],
            cycle.sliding_variable[np.newaxis],
        )
        status = Status(self.law.name, int(self._state.fault), self._acted)
        self._sample = Sample(cycle.torque, telemetry, status)
        self._answered_at = time.monotonic()
        self._lost = False
        self._heard_at = None if self._is_end(stamp) else self._answered_at
        return self._sample

    def _reference_at(self, stamp: int) -> JointReference | None:
        """Newest reference not after `stamp`, extrapolated to it with its own derivatives.

        When it is too old that is a fault, and its position is held.

        In lockstep the sample of exactly this stamp, or a later one, must have come: what the
        answer is then does not depend on which message was faster.
        """
        references = self._references
        if self._loop.lockstep and not (references and references[-1][0] >= stamp):
            return None
        while len(references) > 1 and references[1][0] <= stamp:
            references.popleft()
        if not references or references[0][0] > stamp:
            return None
        known, reference = references[0]
        if known == stamp:
            return reference
        if stamp - known > self._reference_timeout:
            self.trip(faults.REFERENCE_STALE)
            still = np.zeros(len(reference.position))
            return JointReference(reference.position, still, still)
        dt = (stamp - known) / NANOSECONDS
        return JointReference(
            reference.position + dt * reference.velocity + 0.5 * dt * dt * reference.acceleration,
            reference.velocity + dt * reference.acceleration,
            reference.acceleration,
        )

    def _cycle(
        self,
        law: PreparedLaw,
        reference: JointReference,
        measured: JointSample,
        memory: Any,
        dt: float,
    ) -> Cycle:
        return run_cycle(
            law.update,
            law.gains,
            self._robot,
            self._limits,
            reference,
            measured.position,
            measured.velocity,
            self._state,
            memory,
            dt,
        )

    def _is_end(self, stamp: int) -> bool:
        """Whether no state will follow that of `stamp`."""
        samples = self._loop.samples
        if samples is None or self._start is None:
            return False
        return stamp >= self._start + samples * self._loop.period_ns

    def _reset(self) -> None:
        fault = self._state.fault
        self._state = initial_state(self._guess)._replace(fault=fault)
        self._memory = self.law.memory
        self._acted = 0
        self._last = None
        self._pending = None


_STILL = JointSample(np.zeros(3), np.zeros(3), np.zeros(3))
_RESTING = JointReference(np.zeros(3), np.zeros(3), np.zeros(3))


def _typed(values: Mapping[str, Any], gains: Mapping[str, Any]) -> dict[str, Any]:
    """Gains of all laws as the laws take them: 12 becomes 12.0."""
    typed: dict[str, Any] = {}
    for name, law in available(values).items():
        of_law = config.group(gains, law.Gains, name)
        keys = (f'{name}.{parameter.key}' for parameter in parameters(law.Gains))
        typed |= dict(zip(keys, of_law, strict=True))
    return typed


def _equal(one: tuple[Array, ...] | None, other: tuple[Array, ...]) -> bool:
    return one is not None and all(map(np.array_equal, one, other))
