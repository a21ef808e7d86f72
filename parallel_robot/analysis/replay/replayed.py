"""The controller's torques computed again from recorded states and references.

With the recorded law they are the recorded commands, bit for bit. Only states that were answered
are answered again, each with the reference that was used. Where something happened whose first
state is not recorded (new gains, an emergency stop; in older bags a reference that came late), it
is taken to have happened at the state from which on it explains the commands.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.replay.recorded_controller import RecordedController, after, events
from parallel_robot.bags.history import History
from parallel_robot.bags.run_log import RunLog
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
    law = history.statuses[0].law if history.statuses else ''
    if law in configuration.laws:
        configuration = changed(configuration, {'law': law})
    loop = RecordedController(log, configuration)
    common = loop.common_start(history)
    moment, late, k = loop.first(common), 0, 0
    pending = [
        event
        for event in events(history, configuration)
        if not (loop.exact and event.fault in loop.shown)
    ]
    expected = loop.expected.copy()
    torque = np.empty_like(expected)
    slack, remembered = SLACK, True
    while k < len(torque):
        due = loop.stamps[-1] + 1
        if pending:  # a pose that was told is seen in no command: at its recorded time
            due = pending[0].stamp + (0 if pending[0].pose else slack)
        stop = max(k, int(np.searchsorted(loop.stamps, due)))
        before, batch = (k, moment), loop.answer(moment, k, stop, expected)
        torque[k : k + batch.answered] = batch.torque
        moment = moment.moved(batch)
        k += batch.answered
        if k == stop:
            if pending:
                moment = after(moment, pending.pop(0))
            continue
        begun = [event for event in pending if event.stamp - SLACK <= loop.stamps[k]]
        guess = loop.explain_by_events(*before, k, begun, expected)
        if guess is not None:
            k, moment, rest = guess
            pending = rest + pending[len(begun) :]
        elif k == 0 and loop.answer(loop.first(not common), 0, 1, expected).answered:
            moment = loop.first(not common)
        elif not loop.exact and loop.explain_by_late_reference(moment, k, expected):
            late += 1
        else:  # not explained: from here on, everything at its recorded time
            expected[k:] = np.nan
            slack, remembered = 0, remembered and (common or k > 0)
    late += 0 if log.used is None else int(log.used.late.sum())
    return Replay(loop.spread(torque), log.answer, late, remembered)


def instead(log: RunLog, history: History, configuration: ControlConfiguration) -> Replay:
    """Another law or other gains, from the first state to the last."""
    loop = RecordedController(log, configuration, obeyed=False)
    moment = loop.first(loop.common_start(history))
    free = np.full_like(loop.expected, np.nan)
    return Replay(loop.spread(loop.answer(moment, 0, len(free), free).torque), log.answer, 0)
