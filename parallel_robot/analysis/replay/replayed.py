"""The controller's torques computed again from recorded states and references.

With the recorded law they are the recorded commands, bit for bit. Only states that were answered
are answered again, each with the reference that was used. Where something happened whose first
state is not recorded (new gains, an emergency stop; in older bags a reference that came late), it
is taken to have happened at the state from which on it explains the commands.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
from parallel_robot_control.configuration import ControlConfiguration, changed
from parallel_robot_model.common.units import NANOSECONDS

SLACK = NANOSECONDS // 4  # ns, between a change and its record


class Replay(NamedTuple):
    """Torques computed again.

    Attributes:
        torque: [N m], shape (N, n).
        recorded: The recorded commands, NaN where there is none [N m], shape (N, n).
        late: How many states were answered with an older reference, extrapolated.
        remembered: Whether it is known what law and estimator remembered at the first state; not
            in a bag that begins while they run.
    """

    torque: np.ndarray
    recorded: np.ndarray
    late: int
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
        """Answer states up to one, and to another one to see that they are understood.

        Returns:
            The state up to which answers are sure, at `check` or after it, and the moment before.
        """
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
            moment = moment.moved(batch)
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
