"""A controller whose inputs come from a bag, one row a state that it answered."""

from __future__ import annotations

import functools
import itertools
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.history import History
from parallel_robot.bags.run.matching import Used
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_control.assembly import Control, assemble
from parallel_robot_control.batch import Batch, States, answer
from parallel_robot_control.configuration import ControlConfiguration, changed, settings
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller_state import (
    clear,
    drop_torque,
    join,
    rejoin,
    restart,
    set_pose,
    switch,
    trip,
)
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_control.reference_buffer import RESTART, extrapolate_rows
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.limiting import OVERDUE
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.hazard_table import HazardTable

HIDDEN = 2  # states after a change whose torques may not show it yet
PROOF = 20  # states on which guesses are compared
OUTSIDE = {  # faults that states and references do not show
    faults.STATES_STALE,
    faults.REFERENCE_STALE,
    faults.STATES_DISAGREE,
    faults.REFERENCES_DISAGREE,
    faults.EMERGENCY_STOP,
    faults.COMMANDS_DISAGREE,
    faults.STATES_LATE,
    faults.STATES_AHEAD,
    faults.STATES_INVALID,
}
LOST = {  # those in which the torque is zero at once
    faults.STATES_STALE,
    faults.STATES_LATE,
    faults.STATES_AHEAD,
    faults.STATES_INVALID,
}


class Event(NamedTuple):
    """Something that happened to the controller."""

    stamp: int  # when, roughly [ns]
    values: dict[str, Any]  # new law or gains
    # fault that it was brought into, NONE when the fault was cleared, else None
    fault: int | None = None
    pose: tuple[float, ...] = ()  # pose that it was told; empty when it was not


class Past(NamedTuple):
    """Copies of the memories of a law and of the cycle."""

    law: Any
    cycle: Any

    def restore(self, control: Control) -> None:
        """Let a controller remember this."""
        control.law.memory.current = self.law
        control.setup.memory.restore(self.cycle)


def past_of(control: Control) -> Past:
    """What a controller remembers."""
    return Past(control.law.memory.current, control.setup.memory.copy())


class Moment(NamedTuple):
    """All that a controller knows between two states."""

    configuration: ControlConfiguration
    control: Control  # law, robot and limits
    past: Past  # memory of the law and of the cycle, which the cycle changes

    def moved(self) -> Moment:
        """After what :meth:`RecordedController.answer` has just answered."""
        return self._replace(past=past_of(self.control))


class RecordedController:
    """A controller's fixed parts and its inputs, one row a state that it answered."""

    def __init__(
        self, log: RunLog, configuration: ControlConfiguration, obeyed: bool = True
    ) -> None:
        """Take a run.

        Args:
            log: The run.
            configuration: Configuration of the controller.
            obeyed: Whether the recorded torques answer this controller, not another one.

        Raises:
            BagError: it has no velocities, and the estimator takes them.
        """
        estimator = configuration.estimator
        if estimator.takes_velocities and not log.has_velocities:
            raise BagError(
                f'the bag has no velocities, which estimator.kind {estimator.kind} takes; '
                '--set estimator.kind=filter or levant needs none'
            )
        self._configuration = configuration
        self._loop, safety = configuration.loop, configuration.safety
        # how many states an older reference may answer
        self.oldest = round(safety.reference_timeout / self._loop.period)
        # whether the bag says which states were answered, and from which references
        self.exact = log.used is not None
        self._count = len(log.stamps)
        self.rows = np.arange(self._count)  # numbers of the states in the run, shape (A,)
        if log.used is not None:
            self.rows = np.flatnonzero(log.used.stamps)
        # stamps: of the states [ns], shape (A,); expected: the recorded commands, shape
        # (A, n)
        self.stamps, self.expected = log.stamps[self.rows], log.answer[self.rows]
        heard = log.effort if log.has_efforts else np.full_like(log.effort, np.nan)
        self._effort = heard[self.rows]
        steps = np.diff(self.stamps)
        lockstep, states_out = self._loop.lockstep, round(safety.state_timeout * NANOSECONDS)
        begun_anew = ((steps <= 0) | ((steps >= RESTART) & (not lockstep))) & self.exact
        self._restarts = np.flatnonzero(begun_anew) + 1
        # faults that stamps show then
        self.shown = {faults.REFERENCE_STALE, *[faults.STATES_STALE] * lockstep}
        self._gaps = np.flatnonzero((steps > states_out) & self.exact & lockstep) + 1
        dt = np.concatenate([[0.0], steps / NANOSECONDS])
        acts = self.stamps if log.used is None else log.used.acts[self.rows]
        ends = HazardTable(self._loop, safety.state_age).renewals
        rows = np.searchsorted((acts - log.start_stamp) // self._loop.period_ns, ends)
        # rows of the first states that new controllers hear
        self._renewals = rows[(rows > 0) & (rows < len(self.rows))]
        dt[[0, *self._restarts, *self._renewals]] = self._loop.period
        self._states = States(
            log.position[self.rows],
            np.nan_to_num(log.velocity[self.rows]),  # as the node takes them, which has none
            self._effort if obeyed else np.full_like(self._effort, np.nan),
            dt,
            acts // self._loop.period_ns,
            (acts - self.stamps) / NANOSECONDS,
        )
        self._known = JointReference(
            log.reference_position, log.reference_velocity, log.reference_acceleration
        )
        self._references = JointReference(*(row[self.rows] for row in self._known))
        self._stale, overdue = np.zeros((2, len(self.rows)), bool)
        if log.used is not None:
            self._take_used(log.used, round(safety.reference_timeout * NANOSECONDS))
            overdue = acts - log.used.stamps[self.rows] > OVERDUE * NANOSECONDS
        begun = np.flatnonzero(np.diff(self._stale, prepend=False) & self._stale)
        self._returns = np.flatnonzero(overdue[:-1] & ~overdue[1:]) + 1
        edges = (begun, self._restarts, self._gaps, self._renewals, self._returns)
        self._edges = np.unique(np.concatenate(edges))

    def _take_used(self, used: Used, timeout: int) -> None:
        """Take the references that were used; what is older than a time-out [ns] is at rest."""
        rows = np.searchsorted(self.rows, used.older)
        age = used.acts[used.older] - used.stamps[used.older]
        values = extrapolate_rows(age, *used.samples)
        stale = age > timeout
        for field, (row, found) in enumerate(zip(self._references, values, strict=True)):
            row[rows] = found
            row[rows[stale]] = used.samples.position[stale] if field == 0 else 0.0
        self._stale[rows] = stale

    def common_start(self, history: History) -> bool:
        """Whether the first state was the start of the motion, for the controller too."""
        told = int(history.facts.get('start_stamp', 0)) or self._loop.step_start
        acts = self.stamps[0] + round(self._states.age[0] * NANOSECONDS)
        return bool(self.stamps[0] <= told <= acts)

    def spread(self, torque: np.ndarray) -> np.ndarray:
        """Torques of all states, NaN where there is none, from those of the answered ones."""
        whole = np.full((self._count, torque.shape[1]), np.nan)
        whole[self.rows] = torque
        return whole

    def first(self, common: bool) -> Moment:
        """Before the first state; without a common start, the controller takes over."""
        control = assemble(self._configuration)
        if not common:
            join(control.setup.memory.state, self._effort[0])
        return Moment(self._configuration, control, past_of(control))

    def answer(self, moment: Moment, first: int, stop: int, expected: np.ndarray) -> Batch:
        """Answer some states, up to the first torque that is not the expected one.

        A reference that is too old brings the controller into a fault, and in lockstep a state
        that comes after too long; where the stamps begin anew, so does the controller.

        Args:
            moment: Before the first of them.
            first: The first one.
            stop: The one after the last.
            expected: Torques of all states [N m], NaN where any will do.
        """
        stop = min(stop, len(self.stamps))
        control, state = moment.control, moment.control.setup.memory.state
        moment.past.restore(control)
        torques, answered = [], 0
        inside = self._edges[(self._edges > first) & (self._edges < stop)]
        for begin, end in itertools.pairwise([first, *inside.tolist(), stop]):
            if begin in self._renewals:
                state.fault = faults.NONE
            if begin in self._restarts or begin in self._renewals:
                restart(state, np.array(self._configuration.guess))
                join(state, self._effort[begin])
                control.law.reset_memory()
            elif begin in self._gaps:
                trip(state, faults.STATES_STALE)
                drop_torque(state)
            if begin in self._returns:
                rejoin(state)
            if begin < stop and self._stale[begin]:
                trip(state, faults.REFERENCE_STALE)
            rows = slice(begin, end)
            before = past_of(control)
            batch = self._answer(control, rows, expected)
            if batch.answered < end - begin:  # it remembers the state that was not expected
                before.restore(control)
                rows = slice(begin, begin + batch.answered)
                self._answer(control, rows, expected)
            torques.append(batch.torque)
            answered += batch.answered
            if batch.answered < end - begin:
                break
        return Batch(np.concatenate(torques), answered)

    def _answer(self, control: Control, rows: slice, expected: np.ndarray) -> Batch:
        """Answer some rows up to the first torque that is not the expected one."""
        return answer(
            control.setup,
            JointReference(*(row[rows] for row in self._references)),
            self._states.part(rows),
            expected[rows],
        )

    def explain_by_events(
        self, first: int, moment: Moment, k: int, events: list[Event], expected: np.ndarray
    ) -> tuple[int, Moment, list[Event]] | None:
        """Find the state from which on some events explain the command of state k best.

        These are the first ones, or a later one alone: new gains may be recorded after a switch
        of the law that followed them. They may change only what a law remembers: the first torque
        that shows them then is that of the next state.

        Args:
            first: A state before, or k itself.
            moment: Before that state.
            k: The first state whose command is not understood.
            events: What may have happened by then.
            expected: The recorded commands.

        Returns:
            The state, the moment before it, and the events that did not happen; None without
            success.
        """
        best, found = k, None
        choices = [events[: count + 1] for count in range(len(events))]
        choices += [[event] for event in events[1:]]
        for since in range(k, max(first, k - HIDDEN) - 1, -1):
            self.answer(moment, first, since, expected)
            before = moment.moved()
            for happened in choices:
                guess = functools.reduce(after, happened, before)
                explained = since + self.answer(guess, since, k + PROOF, expected).answered
                if explained > best:
                    rest = [event for event in events if event not in happened]
                    best, found = explained, (since, guess, rest)
        return found

    def explain_by_late_reference(self, moment: Moment, k: int, expected: np.ndarray) -> bool:
        """Keep, for state k, the newest older reference that explains its command, if one does.

        For bags that do not say which reference was used.
        """
        for age in [*range(1, min(k, self.oldest) + 1), 0]:  # 0: as it was
            known = slice(k - age, k - age + 1)
            older = extrapolate_rows(
                self.stamps[k : k + 1] - self.stamps[known], *(row[known] for row in self._known)
            )
            for row, values in zip(self._references, older, strict=True):
                row[k] = values[0]
            if self.answer(moment, k, k + 1, expected).answered:
                return True
        return False


def after(moment: Moment, event: Event) -> Moment:
    """What an event makes of a controller."""
    configuration, control, past = moment
    past.restore(control)
    state: Any = control.setup.memory.state
    if event.values:
        before, configuration = control.law, changed(configuration, event.values)
        control = assemble(configuration, memory=control.setup.memory)
        switch(state, before, control.law)
    if len(event.pose) == len(configuration.guess):
        set_pose(state, np.array(event.pose))
    if event.fault == faults.NONE and state.fault != faults.NONE:
        clear(state)
        control.law.reset_memory()
    elif event.fault and state.fault == faults.NONE:
        trip(state, event.fault)
        if event.fault in LOST:
            drop_torque(state)
    return Moment(configuration, control, past_of(control))


def events(history: History, configuration: ControlConfiguration) -> list[Event]:
    """What happened to the controller, in order; a switch may be listed twice, without effect."""
    known = faults.of(configuration.robot.module)
    numbers = {fault.key: number for number, fault in known.items()}
    laws = configuration.laws
    keys = {key for key, _ in settings(configuration)} - {'preset'}
    found = []
    for change in history.changes:
        changed = {key: value for key, value in change.values.items() if key in keys}
        if changed and change.node.endswith('/controller'):
            found.append(Event(change.stamp, changed))
    law, fault = None, NO_FAULT
    pose: tuple[float, ...] = ()
    for status in history.statuses:
        if law not in (None, status.law) and status.law in laws:
            found.append(Event(status.stamp, {'law': status.law}))
        if status.pose not in ((), pose):
            found.append(Event(status.stamp, {}, None, status.pose))
            pose = status.pose
        if status.fault != fault:
            if fault != NO_FAULT:
                found.append(Event(status.stamp, {}, faults.NONE))
            if numbers.get(status.fault) in OUTSIDE:
                found.append(Event(status.stamp, {}, numbers[status.fault]))
        law, fault = status.law, status.fault
    return sorted(found, key=lambda event: event.stamp)
