"""What belongs to a state of a run: the command that answers it, and its reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.columns import Columns, blocks
from parallel_robot.bags.messages.message_arrays import LARGEST, Samples
from parallel_robot_control.contract import JointReference
from parallel_robot_control.reference_buffer import extrapolate_rows
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import topics

# Which state each command answers: as the controller recorded it, or guessed for other bags.

NONE = np.zeros(0, np.int64)
EXTRAPOLATED = ('position', 'velocity', 'acceleration')
MIX = np.uint64(0x9E3779B97F4A7C15)  # odd: powers of it tell the joints apart


class Answers(NamedTuple):
    """Commands of a run with the states that they answer, in their order."""

    states: np.ndarray  # stamp of the state that each answers [ns], shape (R,); 0: it answers none
    references: np.ndarray  # stamp of the reference that it used [ns], shape (R,)
    acts: np.ndarray  # time from which on it acts, as far as the controller knew [ns], shape (R,)
    torque: np.ndarray  # the commands [N m], NaN where they are not ones, shape (R, n)
    # when the records of commands were heard that are between the first and the last one and
    # that the bag lacks [ns]
    lost: np.ndarray = NONE
    gaps: np.ndarray = NONE  # when the commands were heard with which records begin anew [ns]
    heard: np.ndarray = NONE  # when the records of the answers were heard [ns], shape (R,)

    def between(self, begin: int, end: int) -> Answers:
        """Those whose records were heard from one log time up to another [ns]."""
        inside = (self.heard >= begin) & (self.heard < end)
        rows = (each[inside] for each in (*self[:4], self.heard))
        states, references, acts, torque, heard = rows
        return self._replace(
            states=states, references=references, acts=acts, torque=torque, heard=heard
        )


class Used(NamedTuple):
    """References that the controller used."""

    # stamp of the reference used at each state [ns], shape (N,); 0 without an answer
    stamps: np.ndarray
    acts: np.ndarray  # time from which on the torque of each state acts [ns], shape (N,)
    late: np.ndarray  # whether a newer one for that time came too late, shape (N,)
    # the states for which another reference counts than that of their stamp, shape (K,)
    older: np.ndarray
    samples: JointReference  # references of those states as they were published, each shape (K, n)

    def rows(self, chosen: np.ndarray) -> Used:
        """The references of some states, by their numbers in order."""
        inside = np.isin(self.older, chosen)
        samples = JointReference(*(row[inside] for row in self.samples))
        older = np.searchsorted(chosen, self.older[inside])
        return Used(self.stamps[chosen], self.acts[chosen], self.late[chosen], older, samples)


def recorded_answers(messages: Sequence[Samples], commands: Samples) -> Answers | None:
    """What the controller recorded of its answers.

    Args:
        messages: Messages on ``controller/answered``; those without a torque of each joint are
            ignored.
        commands: All commands of the bag.

    Returns:
        The answers; None when there is none of a command of the bag.
    """
    torques = commands.numbers['data']
    width = 3 + torques.shape[1]
    parts = [
        (part.log_times, part.numbers['data'].reshape(len(part.stamps), -1, width))
        for part in messages
        if 'data' in part.numbers and part.numbers['data'].shape[1] % width == 0
    ]
    if not parts:
        return None
    times, ends = (
        np.concatenate([np.repeat(key(*part), part[1].shape[1]) for part in parts])
        for key in (lambda times, _: times, lambda _, rows: rows[:, :, 0].max(axis=1))
    )
    rows = np.concatenate([rows.reshape(-1, width) for _, rows in parts])
    order = np.lexsort((ends, times))
    rows, times = rows[order], times[order]
    torque = rows[:, 3:].copy().view(float)
    kept, told = among(torque, torques), among(torques, torque)
    if not kept.any():
        return None
    torque[~(np.abs(torque) <= LARGEST).all(axis=1)] = np.nan
    (begin, end), (first, last) = (np.flatnonzero(known)[[0, -1]] for known in (kept, told))
    lost = begin + np.flatnonzero(~kept[begin:end])
    gaps = first + 1 + np.flatnonzero(~told[first:last] & told[first + 1 : last + 1])
    states, references, acts = rows[:, :3].T
    return Answers(states, references, acts, torque, times[lost], commands.log_times[gaps], times)


def among(torques: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which torques are among others, bit for bit, shape (N,); both shape (., n)."""
    if len(torques) == len(others) and all(
        np.array_equal(_key(torques[rows]), _key(others[rows])) for rows in blocks(0, len(others))
    ):  # nothing is lost
        return np.ones(len(torques), bool)
    found = np.zeros(len(torques), bool)
    if len(others):
        keys = Columns('the commands')
        for rows in blocks(0, len(others)):
            keys.add({'key': _key(others[rows])})
        ordered = keys.arrays()['key']
        ordered.sort()  # several times as fast as np.isin
        for rows in blocks(0, len(torques)):
            some = _key(torques[rows])
            at = np.minimum(np.searchsorted(ordered, some), len(ordered) - 1)
            found[rows] = ordered[at] == some
    return found


def _key(torques: np.ndarray) -> np.ndarray:
    """A number for each row of torques, another one for other bits, shape (N,)."""
    factors = MIX ** np.arange(torques.shape[1], dtype=np.uint64)
    return np.ascontiguousarray(torques).view(np.uint64) @ factors


def command_of_states(stamps: np.ndarray, states: np.ndarray) -> np.ndarray:
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


def used_references(
    stamps: np.ndarray, acts: np.ndarray, known: np.ndarray, references: Samples
) -> Used:
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


def match_by_time(states: Samples, commands: Samples, whole: bool = True) -> tuple[Answers, bool]:
    """Guess the state that each command answers, for bags that do not say.

    The k-th answers the k-th, except for zeros that the controller sent on its own: at its end,
    or when no states came. Where some of either are lost, a command answers the newest state that
    was recorded before it, which is exact in lockstep.

    Args:
        states: All states of the bag.
        commands: All commands of the bag.
        whole: Whether both begin with the bag; else the k-th need not answer the k-th.

    Returns:
        The answers, with the state for the reference; whether none of either is lost.
    """
    torques, count = commands.numbers['data'], len(states.stamps)
    order = np.arange(len(torques))
    zeros = np.flatnonzero(~torques.any(axis=1))
    if 0 < len(torques) - count <= len(zeros):
        order = np.delete(order, zeros[count - len(torques) :])
    stamps = np.zeros(len(torques), np.int64)
    sure = whole and len(order) == count
    if sure:
        stamps[order] = states.stamps
    else:
        newest = np.searchsorted(states.log_times, commands.log_times, side='right') - 1
        stamps[newest >= 0] = states.stamps[newest[newest >= 0]]
    return Answers(stamps, stamps, stamps, torques, heard=commands.log_times), sure


# The reference of each state: the newest one, how old it is, and what is said without one.

NO_REFERENCE = 'have no reference of their time'


def newest_age(stamps: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Age of the newest reference at each state [ns], shape (N,); negative before the first.

    Args:
        stamps: Of the states [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
    """
    return stamps - known[_newest(stamps, known)]


def _newest(stamps: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Number of the newest of some stamps at others, shape (N,); the first before it."""
    return np.maximum(np.searchsorted(known, stamps, side='right') - 1, 0)


def reference_at(
    stamps: np.ndarray,
    known: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> JointReference:
    """Extrapolate references to other stamps, each from the newest before with its derivatives.

    Args:
        stamps: Where they are wanted; before the first known one, it counts [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
        position: Joint angles [rad], shape (M, n).
        velocity: Their rates [rad/s], shape (M, n).
        acceleration: Their accelerations [rad/s^2], shape (M, n).
    """
    newest = _newest(stamps, known)
    return extrapolate_rows(
        stamps - known[newest], position[newest], velocity[newest], acceleration[newest]
    )


def timeout(values: dict[str, Any], stamps: np.ndarray) -> int:
    """Age at which a reference ends [ns]: that of the controller, at least two periods of it."""
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    return round(max(values['safety.reference_timeout'] * NANOSECONDS, 2.0 * period))


def without_reference(
    stamps: np.ndarray, start: int, known: np.ndarray, referenced: np.ndarray
) -> str:
    """What to know of states without a reference of their time."""
    count, first = int((~referenced).sum()), int(np.argmin(referenced))
    time = (stamps[first] - start) / NANOSECONDS
    if referenced.any():
        return unreferenced(count, time)
    behind = float(np.median(stamps) - np.median(known)) / NANOSECONDS
    return (
        'no state has a reference of its time: the stamps of '
        f'{topics.REFERENCE.name} are {behind:.3g} s behind those of {topics.JOINT_STATES.name}: '
        'of another clock'
    )


def unreferenced(count: int, time: float) -> str:
    """That so many states, from a time on [s], have no reference, in words."""
    what = f'{count} states, from t = {time:.3f} s on, {NO_REFERENCE}'
    return f'{what}: they have no error and are left out'
