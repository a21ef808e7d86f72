"""What became of a loop after a fault: pure functions of what was recorded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array

BOUND = 1e-4  # m, end-effector error below which the loop is well
QUIET = 0.5  # s, for which it must stay there


class Record(NamedTuple):
    """What was seen from the beginning of a fault to the end of the recovery."""

    time: Array  # of the poses, since the beginning of the fault [s], shape (N,)
    distance: Array  # of the platform from its desired place [m], shape (N,)
    over: float  # when the fault was over [s]
    torque: Array  # torques, commanded and applied [N m], shape (M, n)
    finite: bool  # whether all that the loop published was finite
    faults: tuple[str, ...] = ()  # faults of the controller, in order
    notes: tuple[str, ...] = ()  # what else the nodes reported, one text each
    failures: tuple[str, ...] = ()  # nodes that ended or hung, one text each


class Outcome(NamedTuple):
    """A row of the table."""

    fault: str  # what was done
    reaction: str  # what the controller and the plant did about it
    worst: float  # largest end-effector error from the beginning of the fault to the recovery [m]
    # time from the end of the fault until the error stays below BOUND for QUIET seconds [s];
    # None when it does not
    recovery: float | None
    torque: float  # largest torque of any joint [N m]
    failures: tuple[str, ...]  # what must not happen, and did


def judge(fault: str, record: Record, limit: float) -> Outcome:
    """Judge a row.

    Args:
        fault: Its name.
        record: What was seen.
        limit: Of the torques [N m].
    """
    recovery = recovery_time(record.time, record.distance, record.over)
    torque = float(np.abs(record.torque).max(initial=0.0))
    failures = list(record.failures)
    if not record.finite:
        failures.append('a value was not finite')
    if not torque <= limit:
        failures.append(f'torque of {torque:.1f} N m, limit {limit:g} N m')
    if recovery is None and not record.failures:
        failures.append(f'error not below {1e3 * BOUND:g} mm again')
    faults = [f'fault: {text}' for text in dict.fromkeys(record.faults)]
    reaction = '; '.join([*(faults or ['ridden through']), *record.notes])
    last = np.inf if recovery is None else record.over + recovery
    worst = float(record.distance[record.time <= last].max(initial=0.0))
    return Outcome(fault, reaction, worst, recovery, torque, tuple(failures))


def recovery_time(time: Array, distance: Array, over: float) -> float | None:
    """Time from the end of a fault until the error stays below BOUND for QUIET seconds [s].

    Args:
        time: Of the samples [s], shape (N,).
        distance: Of the platform from its desired place [m], shape (N,).
        over: End of the fault [s].

    Returns:
        The time; None when there is none.
    """
    if not time.size:
        return None
    outside = time[~(distance < BOUND) & (time >= over)]  # NaN is outside
    begin, end = np.append(over, outside), np.append(outside, time[-1])
    quiet = np.flatnonzero(end - begin >= QUIET)
    return float(begin[quiet[0]]) - over if quiet.size else None


def is_well(time: Array, distance: Array) -> bool:
    """Whether the error has been below BOUND during the last QUIET seconds of the samples."""
    outside = time[~(distance < BOUND)]
    return bool(time.size) and bool(time[-1] - np.append(time[0], outside)[-1] >= QUIET)
