"""Which command answers which state: as the controller recorded it, or guessed in older bags."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.message_arrays import Samples
from parallel_robot_control.contract import JointReference

UNKNOWN = -1  # stamp where the bag does not say
NEIGHBOURS = 21  # messages (odd) whose median says how many commands came before each of them
EVEN = 0.5, 2.0  # of the usual time between two messages; others came in a burst or after a pause
CALM = 5  # messages to both sides that came so, beside one whose log time counts
EXTRAPOLATED = ('position', 'velocity', 'acceleration')


class Answered(NamedTuple):
    """What the controller recorded about the commands of a bag.

    Attributes:
        states: Stamp of the state that each command answers [ns], shape (M,); 0: it answers none.
        references: Stamp of the reference that it used [ns], shape (M,).
        acts: Time from which on it acts, as far as the controller knew [ns], shape (M,).
        rows: Stamps of all states that were answered [ns], shape (R,).
        rows_act: Times from which on their torques act [ns], shape (R,).
        lost: Commands between the first and the last one that the bag lacks.
        gaps: Places where the bag lacks records of answers.
    """

    states: np.ndarray
    references: np.ndarray
    acts: np.ndarray
    rows: np.ndarray
    rows_act: np.ndarray
    lost: int
    gaps: int


class Used(NamedTuple):
    """References that the controller used.

    Attributes:
        stamps: Stamp of the reference used at each state [ns], shape (N,); 0 without an answer.
        acts: Time from which on the torque of each state acts [ns], shape (N,).
        late: Whether a newer one for that time came too late, shape (N,).
        older: The states for which another reference counts than that of their stamp, shape (K,).
        samples: References of those states as they were published, each shape (K, n).
    """

    stamps: np.ndarray
    acts: np.ndarray
    late: np.ndarray
    older: np.ndarray
    samples: JointReference

    def rows(self, chosen: np.ndarray) -> Used:
        """The references of some states, by their numbers in order."""
        inside = np.isin(self.older, chosen)
        samples = JointReference(*(row[inside] for row in self.samples))
        older = np.searchsorted(chosen, self.older[inside])
        return Used(self.stamps[chosen], self.acts[chosen], self.late[chosen], older, samples)


def align(
    heard: np.ndarray, messages: Sequence[Samples], complete: bool = False
) -> Answered | None:
    """Find the record of each command.

    Records and commands are in the same order, so it is enough to know how many commands came
    before each message of records. The bag may begin in the middle of a message and end before the
    last one; log times may be out of order here and there, so neighbours decide together. Those of
    a recorder that stood still, and then got all at once, say nothing: what came before and after
    it counts. Where nothing is lost, one number holds for all.

    Args:
        heard: Log times of the commands in order [ns], shape (M,).
        messages: Messages on ``controller/answered``; those that do not hold threes are ignored.
        complete: Whether no command and no record is missing between the first and the last.

    Returns:
        What was recorded; None when there is no record.
    """
    pairs = [
        (part.log_times, part.numbers['data'].reshape(len(part.log_times), -1, 3))
        for part in messages
        if 'data' in part.numbers and part.numbers['data'].shape[1] % 3 == 0
    ]
    if not pairs:
        return None
    times = np.concatenate([times for times, _ in pairs])
    last = np.concatenate([rows[:, :, 0].max(axis=1) for _, rows in pairs])
    sizes = np.concatenate([np.full(len(rows), rows.shape[1]) for _, rows in pairs])
    whole = np.concatenate([rows.reshape(-1, 3) for _, rows in pairs])
    order = np.lexsort((last, times))
    starts = (np.cumsum(sizes) - sizes)[order]
    times, sizes = times[order], sizes[order]
    ends = np.cumsum(sizes)
    rows = whole[np.repeat(starts - (ends - sizes), sizes) + np.arange(ends[-1])]

    ahead = ends - np.searchsorted(heard, times, side='right')
    # The last command may be logged after its record: what comes after all of them counts, too.
    after = int(np.median([*ahead[-2:][[0, -1]], ends[-1] - len(heard)]))
    if complete:
        values, counts = np.unique(ahead, return_counts=True)
        ahead = np.full_like(ahead, values[np.argmax(counts)])
    else:
        ahead = _median(_calm(times, ahead), after)
    free = np.maximum.accumulate(np.concatenate([[0], ends - ahead]))[:-1]
    command = np.arange(len(rows)) - np.repeat(ahead, sizes)
    found = (command >= np.repeat(free, sizes)) & (command < len(heard))
    stamps = np.full((len(heard), 3), UNKNOWN)
    stamps[command[found]] = rows[found]
    steps = np.diff(ahead)
    return Answered(
        stamps[:, 0],
        stamps[:, 1],
        stamps[:, 2],
        rows[rows[:, 0] > 0, 0],
        rows[rows[:, 0] > 0, 2],
        int(steps[steps > 0].sum()),
        int((steps < 0).sum()),
    )


def _calm(times: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """How far records are ahead, where their messages did not come as usual by those that did.

    Args:
        times: Log times of the messages [ns], shape (K,).
        ahead: Records less commands up to each of them, shape (K,).
    """
    steps = np.diff(times)
    usual = np.median(steps) if len(steps) else 0.0
    even = (steps >= EVEN[0] * usual) & (steps <= EVEN[1] * usual)
    around = np.pad(even, CALM, constant_values=True)
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * CALM)
    calm = np.flatnonzero(windows.all(axis=1))
    if 2 * len(calm) < len(times):  # nothing is usual here
        return ahead
    rows = np.arange(len(times))
    next_one = np.searchsorted(calm, rows)
    before = ahead[calm[np.maximum(next_one - 1, 0)]]
    after = ahead[calm[np.minimum(next_one, len(calm) - 1)]]
    found = np.clip(ahead, np.minimum(before, after), np.maximum(before, after))
    found[calm] = ahead[calm]
    return found


def _median(values: np.ndarray, after: int) -> np.ndarray:
    """Median of the neighbours of each value; the first and `after` stand for those beyond."""
    beyond = NEIGHBOURS // 2
    around = np.concatenate([np.full(beyond, values[0]), values, np.full(beyond, after)])
    windows = np.lib.stride_tricks.sliding_window_view(around, NEIGHBOURS)
    return np.partition(windows, NEIGHBOURS // 2)[:, NEIGHBOURS // 2]


def by_state(stamps: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Command that answers each state, -1 where there is none, shape (N,).

    Args:
        stamps: Stamps of the states [ns], shape (N,).
        states: Stamp of the state that each command answers [ns], shape (M,).
    """
    order = np.argsort(stamps, kind='stable')
    at = np.searchsorted(stamps, states, side='right', sorter=order) - 1
    at = order[np.maximum(at, 0)]  # the last one of those with this stamp
    found = stamps[at] == states
    command = np.full(len(stamps), -1)
    command[at[found]] = np.flatnonzero(found)
    return command


def used(stamps: np.ndarray, acts: np.ndarray, known: np.ndarray, references: Samples) -> Used:
    """Find the references that were used.

    Args:
        stamps: Stamps of the states [ns], shape (N,).
        acts: Time from which on the torque of each state acts [ns], shape (N,).
        known: Stamp of the reference used at each state [ns], shape (N,); 0: none.
        references: All references; where the bag lacks one, the one before takes its place.
    """
    order = np.argsort(references.stamps, kind='stable')
    ordered = references.stamps[order]
    at = np.maximum(np.searchsorted(ordered, known, side='right') - 1, 0)
    newest = np.searchsorted(ordered, acts, side='right') - 1
    answered = (known > 0) & (ordered[at] > 0)  # a stamp of zero is not a time
    found = np.where(answered, ordered[at], 0)
    older = np.flatnonzero(answered & ((found != acts) | (acts != stamps)))
    samples = [references.numbers[name][order[at[older]]] for name in EXTRAPOLATED]
    late = answered & (found < ordered[newest])
    return Used(found, acts, late, older, JointReference(*samples))


def guess(states: Samples, commands: Samples) -> tuple[np.ndarray, bool]:
    """Guess the state that each command answers, for bags that do not say.

    The k-th answers the k-th, except for zeros that the controller sent on its own: at its end,
    or when no states came. Where some of either are lost, a command answers the newest state that
    was recorded before it, which is exact in lockstep.

    Args:
        states: All states of the bag.
        commands: All commands of the bag.

    Returns:
        Stamps of the states [ns], shape (M,), 0 where a command answers none; whether none of
        either is lost.
    """
    torques, count = commands.numbers['data'], len(states.stamps)
    order = np.arange(len(torques))
    zeros = np.flatnonzero(~torques.any(axis=1))
    if 0 < len(torques) - count <= len(zeros):
        order = np.delete(order, zeros[count - len(torques) :])
    stamps = np.zeros(len(torques), np.int64)
    if len(order) == count:
        stamps[order] = states.stamps
        return stamps, True
    newest = np.searchsorted(states.log_times, commands.log_times, side='right') - 1
    stamps[newest >= 0] = states.stamps[newest[newest >= 0]]
    return stamps, False
