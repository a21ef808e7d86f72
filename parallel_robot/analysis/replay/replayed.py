"""The controller's torques computed again from recorded states and references.

With the recorded law they are the recorded commands, bit for bit. Only states that were answered
are answered again, each with the reference that was used. Where something happened whose first
state is not recorded (new gains, an emergency stop; in older bags a reference that came late), it
is taken to have happened at the state from which on it explains the commands.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis.replay.recorded_controller import (
    HIDDEN,
    PROOF,
    Event,
    Moment,
    RecordedController,
    after,
    events,
)
from parallel_robot.bags.history import History
from parallel_robot.bags.run import run_log
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_control.assembly import assemble
from parallel_robot_control.batch import States, answer
from parallel_robot_control.configuration import ControlConfiguration, changed, configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller_state import join
from parallel_robot_control.reference_buffer import RESTART
from parallel_robot_model.common.tables import Table
from parallel_robot_model.common.units import HINGES, NANOSECONDS, Array, JointUnits

SLACK = NANOSECONDS // 4  # ns, between a change and its record


class Replay(NamedTuple):
    """Torques computed again."""

    torque: np.ndarray  # [N m], shape (N, n)
    recorded: np.ndarray  # the recorded commands, NaN where there is none [N m], shape (N, n)
    late: int  # how many states were answered with an older reference, extrapolated
    # whether it is known what law and estimator remembered at the first state; not in a bag
    # that begins while they run
    remembered: bool = True

    @property
    def known(self) -> np.ndarray:
        """Which states have a recorded command, shape (N,)."""
        return ~np.isnan(self.recorded).any(axis=1)

    @property
    def differing(self) -> np.ndarray:
        """Which commands are not the recorded ones, bit for bit, shape (N,)."""
        bits = self.torque.view(np.int64) != self.recorded.view(np.int64)
        return bits.any(axis=1) & self.known


def again(log: RunLog, history: History, configuration: ControlConfiguration) -> Replay:
    """The recorded law, with every switch and fault that is known.

    Args:
        log: The run.
        history: What happened beside the motion.
        configuration: Configuration of the controller at the first state.
    """
    return InParts(history, configuration).answered(log, last=True)[1]


def instead(log: RunLog, history: History, configuration: ControlConfiguration) -> Replay:
    """Another law or other gains, from the first state to the last."""
    return InParts(history, configuration, obeyed=False).answered(log, last=True)[1]


class InParts:
    """A run answered again part by part, bit for bit as at once.

    The last states of a part are answered once more with the next one: what happened to the
    controller is known from the commands after it.
    """

    def __init__(
        self, history: History, configuration: ControlConfiguration, obeyed: bool = True
    ) -> None:
        """Begin before the first state.

        Args:
            history: What happened beside the motion.
            configuration: Configuration of the controller at the first state.
            obeyed: Whether it is the recorded law, with every switch and fault that is known;
                else another law or other gains, from the first state to the last.
        """
        law = history.statuses[0].law if history.statuses else ''
        if obeyed and law in configuration.laws:
            configuration = changed(configuration, {'law': law})
        self._history, self._configuration, self._obeyed = history, configuration, obeyed
        self._moment: Moment | None = None  # before the first state that is not answered
        self._pending: list[Event] = []
        self._explained = obeyed  # up to now
        self._slack, self._remembered = SLACK, True
        self._late: set[int] = set()  # stamps of states whose older reference was found
        self._kept: RunLog | None = None  # states that the next part needs
        self._skip = 0  # how many answers of them are known

    def answered(self, log: RunLog, last: bool) -> tuple[RunLog, Replay]:
        """Answer the states of the next part.

        Args:
            log: The part.
            last: Whether it is the last one.

        Returns:
            States that are answered now, some of them of the part before, and their torques.

        Raises:
            WholeNeededError: the parts do not hold the same.
        """
        if self._kept is not None:
            log = run_log.joined(self._kept, log)
        loop = RecordedController(log, self._configuration, self._obeyed)
        count, first = len(loop.stamps), self._skip
        stop = count if last else count - PROOF
        check = stop if last else stop - HIDDEN
        torque = np.full_like(loop.expected, np.nan)
        if not last and check <= first:  # too few to go on
            self._kept = log
            nothing = run_log.head(log, 0)
            return nothing, Replay(nothing.answer, nothing.answer, 0, self._remembered)
        end, self._moment = self._answer(loop, torque, check, stop)
        begin = int(loop.rows[first]) if first else 0
        until = len(log.stamps) if last else int(loop.rows[end])
        kept = max(0, end - loop.oldest - 2)
        self._skip = end - kept
        if not last:
            since = int(loop.rows[kept]) if kept else 0
            self._kept = run_log.rows(log, np.arange(since, len(log.stamps)))
        part = run_log.rows(log, np.arange(begin, until))
        late = 0
        if self._obeyed:
            found = {stamp for stamp in self._late if last or stamp < loop.stamps[end]}
            self._late -= found
            late = len(found) + (0 if part.used is None else int(part.used.late.sum()))
        spread = loop.spread(torque)[begin:until]
        return part, Replay(spread, part.answer, late, self._remembered)

    def _answer(
        self, loop: RecordedController, torque: np.ndarray, check: int, stop: int
    ) -> tuple[int, Moment]:
        """Answer states up to one, and to another one to see that they are understood."""
        moment, k, common = self._moment, self._skip, loop.common_start(self._history)
        begins = moment is None
        if moment is None:
            moment = loop.first(common)
            self._pending = [
                event
                for event in events(self._history, self._configuration)
                if self._obeyed and not (loop.exact and event.fault in loop.shown)
            ]
        expected = loop.expected.copy() if self._explained else np.full_like(torque, np.nan)
        before = sure = k, moment
        while k < stop:
            due = loop.stamps[-1] + 1
            if self._pending:  # a pose that was told is seen in no command: at its recorded time
                event = self._pending[0]
                due = event.stamp + (0 if event.pose else self._slack)
            happens = max(k, int(np.searchsorted(loop.stamps, due)))
            until = min(happens, check if k < check else stop)
            batch = loop.answer(moment, k, until, expected)
            torque[k : k + batch.answered] = batch.torque
            moment = moment.moved()
            k += batch.answered
            if k == until < happens:
                sure = (k, moment) if k == check else sure
                continue
            if k == until:
                if self._pending:
                    moment = after(moment, self._pending.pop(0))
            else:
                k, moment = self._explained_at(loop, before, k, moment, expected, begins, common)
            before = k, moment
            sure = before if k >= check else sure
        return sure if check < stop else (k, moment)

    def _explained_at(
        self,
        loop: RecordedController,
        before: tuple[int, Moment],
        k: int,
        moment: Moment,
        expected: np.ndarray,
        begins: bool,
        common: bool,
    ) -> tuple[int, Moment]:
        """Where to go on after a state whose command is not understood, and the moment before."""
        begun = [event for event in self._pending if event.stamp - SLACK <= loop.stamps[k]]
        guess = loop.explain_by_events(*before, k, begun, expected)
        begins = begins and k == 0
        if guess is not None:
            k, moment, rest = guess
            self._pending = rest + self._pending[len(begun) :]
        elif begins and loop.answer(loop.first(not common), 0, 1, expected).answered:
            moment = loop.first(not common)
        elif not loop.exact and loop.explain_by_late_reference(moment, k, expected):
            self._late.add(int(loop.stamps[k]))
        else:  # not explained: from here on, everything at its recorded time
            expected[k:] = np.nan
            self._explained, self._slack = False, 0
            self._remembered &= common or not begins
        return k, moment


# What came of torques that were computed again, added up over the parts of a run.


class Totals(NamedTuple):
    """Figures of a part of a run, or of all of it."""

    states: int  # number of states
    answered: int  # how many were answered again
    known: int  # how many have a recorded command
    differing: int  # how many commands are not the recorded ones, bit for bit
    first: float  # time of the first of those [s]; NaN where there is none
    most: float  # largest difference of those [N m]
    largest: Array  # largest difference of each joint [N m], shape (n,)
    squares: Array  # sum of their squares [N^2 m^2], shape (n,)
    late: int  # how many states were answered with a reference that came late
    remembered: bool  # whether it is known what law and estimator remembered at the first state

    def and_then(self, after: Totals) -> Totals:
        """The figures with those of the part that follows."""
        return Totals(
            self.states + after.states,
            self.answered + after.answered,
            self.known + after.known,
            self.differing + after.differing,
            after.first if math.isnan(self.first) else self.first,
            max(self.most, after.most),
            np.maximum(self.largest, after.largest),
            self.squares + after.squares,
            self.late + after.late,
            after.remembered,
        )

    def verdict(self, said: bool, units: JointUnits = HINGES) -> list[str]:
        """Whether the torques are the recorded commands.

        Args:
            said: Whether the bag says which states were answered.
            units: Units of the joints.
        """
        lines = []
        if self.late:
            lines.append(f'{self.late} states were answered with a reference that came late')
        if self.known < self.states:
            what = 'were not answered' if said else 'have no recorded command'
            lines.append(f'{self.states - self.known} states {what}')
        if not self.differing:
            return [*lines, f'identical: {self.known} commands']
        if not self.remembered:
            lines.append(
                'not compared: the bag begins while the controller ran, and what law and '
                'estimator remembered then is not in it; with an empty memory:'
            )
        return [
            *lines,
            f'{self.differing} of {self.known} commands differ, by up to {self.most:.3g} '
            f'{units.of("N m")}, '
            f'from t = {self.first:.3f} s on',
        ]

    def differences(self) -> dict[str, Array]:
        """Differences to the recorded commands [N m], each shape (n,)."""
        return {'rms': np.sqrt(self.squares / self.known), 'max': self.largest}

    def table(self, joints: Sequence[str], units: JointUnits = HINGES) -> Table:
        """Difference to the recorded commands, joint by joint."""
        rows = self.differences().items()
        cells = [[name, *(f'{value:.3f}' for value in values)] for name, values in rows]
        return Table([units.label('difference of torques [N m]'), *joints], cells)


def totals_of(time: Array, result: Replay) -> Totals:
    """The figures of some states; `time` of them [s], shape (N,)."""
    differing, known = np.flatnonzero(result.differing), result.known
    difference = np.abs(result.torque - result.recorded)
    return Totals(
        len(time),
        int((~np.isnan(result.torque[:, 0])).sum()),
        int(known.sum()),
        len(differing),
        float(time[differing[0]]) if differing.size else math.nan,
        float(difference[differing].max()) if differing.size else 0.0,
        difference[known].max(axis=0, initial=0.0),
        (difference[known] ** 2).sum(axis=0),
        result.late,
        result.remembered,
    )


# What another law would ask for on the states of a motion, computed while it goes on.
#
# As a program: compiles the law of the configuration that stands, as JSON, on its standard input.
# Compilation holds up all threads of a process, and in another process it holds up nobody.


class Ghost:
    """A controller that sees states and references, and whose torques go nowhere."""

    def __init__(self, configuration: ControlConfiguration, age: int = 0) -> None:
        """Prepare a law; it takes over at the first state.

        Args:
            configuration: Of the controller, with the law.
            age: Of a state when the controller gets it, as it knows it [ns].
        """
        self.law = configuration.loop.law
        self._configuration, self._age = configuration, age
        self._last: int | None = None
        row = np.zeros((1, configuration.joints))
        self._begin(row[0])  # and whatever is compiled is compiled now
        stamps = np.array([configuration.loop.period_ns], dtype=np.int64)
        self.answer(stamps, row, row, JointReference(row, row, row), row)
        self._last = None

    def _begin(self, effort: Array) -> None:
        self._control = assemble(self._configuration)
        join(self._control.setup.memory.state, effort)

    def answer(
        self,
        stamps: NDArray[np.int64],
        position: Array,
        velocity: Array,
        references: JointReference,
        effort: Array,
    ) -> Array:
        """Torques that the law asks for [N m], shape (N, n).

        Args:
            stamps: Of the next states [ns], increasing, shape (N,).
            position: Measured angles [rad], shape (N, n).
            velocity: Measured rates [rad/s], shape (N, n).
            references: Desired motion when the torques act, each shape (N, n).
            effort: Torques that acted [N m], shape (N, n); where the law begins, it takes over
                from them.
        """
        if not len(stamps):
            return np.empty_like(position)
        loop = self._configuration.loop
        if self._last is None or not 0 < stamps[0] - self._last < RESTART:
            self._begin(effort[0])
            self._last = int(stamps[0]) - loop.period_ns
        states = States(
            np.ascontiguousarray(position),
            np.ascontiguousarray(velocity),
            np.full_like(effort, np.nan),  # those of another law do not obey this one
            np.diff(stamps, prepend=self._last) / NANOSECONDS,
            (stamps + self._age) // loop.period_ns,
            np.full(len(stamps), self._age / NANOSECONDS),
        )
        self._last = int(stamps[-1])
        free = np.full_like(states.position, np.nan)
        references = JointReference(*map(np.ascontiguousarray, references))
        return answer(self._control.setup, references, states, free).torque


if __name__ == '__main__':
    Ghost(configure(json.load(sys.stdin)))
