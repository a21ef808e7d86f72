"""A controller whose inputs come from a bag, one row a state that it answered."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from contextlib import nullcontext
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_bags.answers import Used
from parallel_robot_bags.history import NOTHING, History
from parallel_robot_bags.run_log import RunLog, extrapolated
from parallel_robot_base import config
from parallel_robot_base.kernel import in_memory
from parallel_robot_base.loop import STEP_START, LoopParameters
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import faults
from parallel_robot_control.answering import RESTART
from parallel_robot_control.batch import Batch, States, answer, answers
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import first_guess
from parallel_robot_control.cycle import CycleState, initial_state, run_cycle, taking_over
from parallel_robot_control.laws import LAWS, PreparedLaw, available, prepare
from parallel_robot_control.safety import SafetyParameters, limits_of
from parallel_robot_model.planar_3rrr.parameters import RobotParameters, validate

HIDDEN = 2  # states after a change whose torques may not show it yet
PROOF = 20  # states on which guesses are compared
OUTSIDE = {  # faults that states and references do not show
    faults.STATES_STALE,
    faults.REFERENCE_STALE,
    faults.STATES_DISAGREE,
    faults.REFERENCES_DISAGREE,
    faults.EMERGENCY_STOP,
}


class Event(NamedTuple):
    """Something that happened to the controller.

    Attributes:
        stamp: When, roughly [ns].
        values: New law or gains.
        fault: Fault that it was brought into, NONE when the fault was cleared, else None.
    """

    stamp: int
    values: dict[str, Any]
    fault: int | None = None


class Moment(NamedTuple):
    """All that a controller knows between two states."""

    values: Mapping[str, Any]
    law: PreparedLaw
    state: CycleState
    memory: Any


class RecordedController:
    """A controller's fixed parts and its inputs, one row a state that it answered.

    Attributes:
        exact: Whether the bag says which states were answered, and from which references.
        stamps: Of the states [ns], shape (A,).
        expected: The recorded commands, shape (A, n).
    """

    def __init__(self, log: RunLog, values: Mapping[str, Any]) -> None:
        self._values = values
        self._robot = validate(config.group(values, RobotParameters, 'robot'))
        self._loop = config.group(values, LoopParameters, '')
        safety = config.group(values, SafetyParameters, 'safety')
        self._limits = limits_of(safety)
        self._oldest = round(safety.reference_timeout / self._loop.period)
        self.exact = log.used is not None
        self._count = len(log.stamps)
        self._rows = np.arange(self._count)
        if log.used is not None:
            self._rows = np.flatnonzero(log.used.stamps)
        self.stamps, self.expected = log.stamps[self._rows], log.answer[self._rows]
        self._effort = log.effort[self._rows]
        steps = np.diff(self.stamps)
        begun_anew = ((steps <= 0) | (steps >= RESTART)) & self.exact
        self._restarts = np.flatnonzero(begun_anew) + 1
        dt = np.concatenate([[0.0], steps / NANOSECONDS])
        dt[[0, *self._restarts]] = self._loop.period
        self._states = States(log.position[self._rows], log.velocity[self._rows], dt)
        self._known = JointReference(
            log.reference_position, log.reference_velocity, log.reference_acceleration
        )
        self._references = JointReference(*(row[self._rows] for row in self._known))
        self._stale = np.zeros(len(self._rows), bool)
        if log.used is not None:
            self._take_used(log.used, round(safety.reference_timeout * NANOSECONDS))
        begun = np.flatnonzero(np.diff(self._stale, prepend=False) & self._stale)
        self._edges = np.union1d(begun, self._restarts)

    def _take_used(self, used: Used, timeout: int) -> None:
        """Take the references that were used; what is older than a time-out [ns] is at rest."""
        rows = np.searchsorted(self._rows, used.older)
        age = self.stamps[rows] - used.stamps[used.older]
        values = extrapolated(age, *used.samples)
        stale = age > timeout
        for field, (row, found) in enumerate(zip(self._references, values, strict=True)):
            row[rows] = found
            row[rows[stale]] = used.samples.position[stale] if field == 0 else 0.0
        self._stale[rows] = stale

    def common_start(self, history: History) -> bool:
        """Whether the first state was the start of the motion, for the controller too."""
        told = int(history.facts.get('start_stamp', 0)) or STEP_START
        return bool(self.stamps[0] == told)

    def spread(self, torque: np.ndarray) -> np.ndarray:
        """Torques of all states, NaN where there is none, from those of the answered ones."""
        whole = np.full((self._count, torque.shape[1]), np.nan)
        whole[self._rows] = torque
        return whole

    def first(self, common: bool) -> Moment:
        """Before the first state; without a common start, the controller takes over."""
        law = prepare(self._values['law'], self._values)
        state = initial_state(np.array(first_guess(self._values)), self._effort.shape[1])
        state = state if common else taking_over(state, self._effort[0])
        return Moment(self._values, law, state, law.memory)

    def answer(self, moment: Moment, first: int, stop: int, expected: np.ndarray) -> Batch:
        """Answer some states, up to the first torque that is not the expected one.

        A reference that is too old brings the controller into a fault; where answers stayed away
        for too long, it begins anew.

        Args:
            moment: Before the first of them.
            first: The first one.
            stop: The one after the last.
            expected: Torques of all states [N m], NaN where any will do.
        """
        stop = min(stop, len(self.stamps))
        law, state, memory = moment.law, moment.state, moment.memory
        torques, answered = [], 0
        inside = self._edges[(self._edges > first) & (self._edges < stop)]
        for begin, end in itertools.pairwise([first, *inside.tolist(), stop]):
            if begin in self._restarts:
                pose = np.array(first_guess(self._values))
                state = initial_state(pose, len(state.held))._replace(fault=state.fault)
                state, memory = taking_over(state, self._effort[begin]), law.memory
            if begin < stop and self._stale[begin] and state.fault == faults.NONE:
                state = state._replace(fault=faults.REFERENCE_STALE, held=state.last.position)
            rows = slice(begin, end)
            with in_memory(answers, run_cycle) if law.name not in LAWS else nullcontext():
                batch = answer(
                    law.update,
                    law.gains,
                    self._robot,
                    self._limits,
                    JointReference(*(row[rows] for row in self._references)),
                    States(*(row[rows] for row in self._states)),
                    expected[rows],
                    state,
                    memory,
                )
            torques.append(batch.torque)
            answered += batch.answered
            state, memory = batch.state, batch.memory
            if batch.answered < end - begin:
                break
        return Batch(np.concatenate(torques), answered, state, memory)

    def explain_by_events(
        self, first: int, moment: Moment, k: int, events: list[Event], expected: np.ndarray
    ) -> tuple[int, Moment, int] | None:
        """Find the state from which on the first events explain the command of state k best.

        New gains may change only what a law remembers: the first torque that shows them then is
        that of the next state.

        Args:
            first: A state before, or k itself.
            moment: Before that state.
            k: The first state whose command is not understood.
            events: What may have happened by then.
            expected: The recorded commands.

        Returns:
            The state, the moment before it, and how many events happened; None without success.
        """
        best, found = k, None
        for since in range(k, max(first, k - HIDDEN) - 1, -1):
            batch = self.answer(moment, first, since, expected)
            guess = moment._replace(state=batch.state, memory=batch.memory)
            for happened, event in enumerate(events, start=1):
                guess = after(guess, event)
                explained = since + self.answer(guess, since, k + PROOF, expected).answered
                if explained > best:
                    best, found = explained, (since, guess, happened)
        return found

    def explain_by_late_reference(self, moment: Moment, k: int, expected: np.ndarray) -> bool:
        """Keep, for state k, the newest older reference that explains its command, if one does.

        For bags that do not say which reference was used.
        """
        for age in [*range(1, min(k, self._oldest) + 1), 0]:  # 0: as it was
            known = slice(k - age, k - age + 1)
            older = extrapolated(
                self.stamps[k : k + 1] - self.stamps[known], *(row[known] for row in self._known)
            )
            for row, values in zip(self._references, older, strict=True):
                row[k] = values[0]
            if self.answer(moment, k, k + 1, expected).answered:
                return True
        return False


def after(moment: Moment, event: Event) -> Moment:
    """What an event makes of a controller, as Controller does it."""
    values, law, state, memory = moment
    values = {**values, **event.values}
    last = state.last.torque
    if event.values:
        new = prepare(values['law'], values)
        if (new.name, new.gains) != (law.name, law.gains):
            memory = memory if new.name == law.name else new.memory
            state = taking_over(state, last) if state.last.known else state
            law = new
    if event.fault == faults.NONE and state.fault != faults.NONE:
        state = taking_over(state, last)._replace(fault=faults.NONE)
        memory = law.memory
    elif event.fault and state.fault == faults.NONE:
        state = state._replace(fault=event.fault, held=state.last.position)
        if event.fault == faults.STATES_STALE:
            state = state._replace(last=state.last._replace(torque=np.zeros(len(last))))
    return Moment(values, law, state, memory)


def events(history: History, values: Mapping[str, Any]) -> list[Event]:
    """What happened to the controller, in order; twice told does no harm."""
    codes = {text: code for code, text in faults.FAULT_TEXT.items()}
    laws = available(values)
    keys = {'law', *(key for key in values if key.partition('.')[0] in laws)}
    found = []
    for change in history.changes:
        changed = {key: value for key, value in change.values.items() if key in keys}
        if changed and change.node.endswith('/controller'):
            found.append(Event(change.stamp, changed))
    law, fault = None, NOTHING
    for said in history.statuses:
        if law not in (None, said.law) and said.law in laws:
            found.append(Event(said.stamp, {'law': said.law}))
        if said.fault != fault:
            if fault != NOTHING:
                found.append(Event(said.stamp, {}, faults.NONE))
            if codes.get(said.fault) in OUTSIDE:
                found.append(Event(said.stamp, {}, codes[said.fault]))
        law, fault = said.law, said.fault
    return sorted(found, key=lambda event: event.stamp)
