"""What a recorded drill shows: stops, processes that stand still, and what the robot did then."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.history import ControllerStatus
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.units import NANOSECONDS


class Finding(NamedTuple):
    """Whether something held, what was seen, and from when to when, since t = 0 [s]."""

    holds: bool
    text: str
    span: tuple[float, float] = (0.0, 0.0)


def fault_between(
    log: RunLog, statuses: Sequence[ControllerStatus], wanted: str, begin: float, end: float
) -> Finding:
    """Whether the controller was in one fault within a time, and in none at its end.

    Args:
        log: The run.
        statuses: Of its controller, in order.
        wanted: Code of the fault.
        begin: When it may begin, since t = 0 [s].
        end: When it must have been cleared [s].
    """
    times = [(status.stamp - log.start_stamp) / NANOSECONDS for status in statuses]
    seen = [
        (time, status.fault)
        for time, status in zip(times, statuses, strict=True)
        if begin <= time <= end
    ]
    began = next((time for time, fault in seen if fault == wanted), None)
    if began is None:
        others = sorted({fault for _, fault in seen} - {NO_FAULT})
        return Finding(False, f'no fault {wanted}' + (f', but {", ".join(others)}' * bool(others)))
    last = seen[-1][1]
    if last != NO_FAULT:
        return Finding(False, f'{last} was not cleared')
    cleared = next(time for time, fault in seen if time > began and fault == NO_FAULT)
    text = f'{wanted} at t = {began:.2f} s, cleared at {cleared:.2f} s'
    return Finding(True, text, (began, cleared))


def motors_braked(log: RunLog, begin: float, end: float) -> Finding:
    """Whether the motors took away energy all the time, and how far the joints went.

    Args:
        log: The run.
        begin: When the motors had their safe action, since t = 0 [s].
        end: Until when [s].
    """
    rows = (log.time >= begin) & (log.time <= end)
    if rows.sum() < 2:
        return Finding(False, f'no states from t = {begin:.2f} to {end:.2f} s')
    if not (log.has_efforts and log.has_velocities):
        return Finding(False, 'the bag does not tell: it has no efforts or no velocities')
    power = (log.effort[rows] * log.velocity[rows]).sum(axis=1)
    drift = float(np.abs(np.ptp(log.position[rows], axis=0)).max())
    speed = float(np.abs(log.velocity[rows][-1]).max())
    driven = float(np.maximum(power, 0.0).max())
    rad, rate = log.units.of('rad'), log.units.of('rad/s')
    text = f'joints went {drift:.2g} {rad}, {speed:.2g} {rate} at the end'
    if driven > 1e-3:  # W, more than the noise of velocities makes
        return Finding(False, f'the motors drove with up to {driven:.2g} W; {text}')
    return Finding(True, f'the motors braked; {text}')
