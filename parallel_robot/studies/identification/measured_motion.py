"""What of a bag can be used to identify a robot: stretches of motion under known torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags import gathered_run
from parallel_robot.bags.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run_log import RunLog
from parallel_robot.bags.statuses import ControllerStatus
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.configuration.groups import group
from parallel_robot_model.configuration.zero_angles import corrected
from parallel_robot_sim.plant import PlantParameters

COLUMNS = 'position', 'velocity', 'effort', 'reference_velocity', 'answer'  # of a run
GAP = 5.5  # periods without a state, beyond which the motion between them is not known
LONGEST = 100_000  # samples of a stretch, which bounds the memory
SATURATED = 1.0 - 1e-6  # of the limit of the motors
STILL = 2e-3  # rad/s, rms of a joint that stands still
SPAN = 0.1  # s over which its rate is taken, so that noise does not count as motion


@dataclass(frozen=True)
class MeasuredMotion:
    """Joints and torques over time.

    Attributes:
        time: Stamps, increasing [s], shape (N,).
        position: Measured joints [rad], shape (N, n).
        effort: Torque in the step that ended at the stamp [N m], shape (N, n).
        usable: Whether the torque of that step is known and meant, shape (N,).
        left_out: What is not usable, one line each.
    """

    time: Array
    position: Array
    effort: Array
    usable: NDArray[np.bool_]
    left_out: tuple[str, ...] = ()

    @property
    def period(self) -> float:
        """Time between two samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def speed(self) -> Array:
        """rms of the rate of each joint [rad/s], shape (n,)."""
        step = max(1, min(round(SPAN / self.period), len(self.time) - 1))
        way = self.position[step:] - self.position[:-step]
        rate = way / (self.time[step:] - self.time[:-step])[:, np.newaxis]
        return np.sqrt(np.mean(rate**2, axis=0))


def read(
    bag: Path, memory: int = MEMORY, view: BagView = AS_RECORDED
) -> tuple[RunLog, MeasuredMotion]:
    """Read a bag.

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of it [bytes].
        view: What it does not say itself, and which part is wanted.

    Raises:
        BagError: not a bag of a run, or it holds no torques or no motion.
    """
    log, past = gathered_run.read(bag, COLUMNS, memory, True, view)
    limit = group(log.config, PlantParameters, 'plant').torque_limit
    try:
        motion = of(log, past.statuses, np.array(limit))
    except BagError as error:
        raise BagError(f'{bag}: {error}') from None
    return log, replace(motion, position=corrected(log.config, motion.position))


def of(log: RunLog, statuses: Sequence[ControllerStatus], torque_limit: Array) -> MeasuredMotion:
    """What can be used of a run.

    Args:
        log: The run.
        statuses: Statuses of the controller, in order.
        torque_limit: Saturation of the motors [N m], shape (n,).

    Raises:
        BagError: no torque was recorded, or the robot did not move.
    """
    newer = np.diff(log.stamps, prepend=log.stamps[:1] - 1) > 0
    newer &= log.stamps >= np.maximum.accumulate(log.stamps)
    chosen = slice(None) if newer.all() else newer  # copies nothing
    time, position, effort = log.time[chosen], log.position[chosen], log.effort[chosen]
    silent = [joint for joint, row in zip(log.joints, effort.T, strict=True) if not row.any()]
    if silent:
        raise BagError(f'the effort of {", ".join(silent)} is zero in every joint state')
    if len(time) < 2:
        raise BagError('it holds a single joint state')
    every = np.ones(len(time), bool)
    if (MeasuredMotion(time, position, effort, every).speed < STILL).all():
        still = f'{STILL:g} {log.units.of("rad/s")}'
        raise BagError(f'the robot stood still: no joint reached {still} (rms)')
    faulted = _faulted(log.stamps[chosen], statuses)
    saturated = (np.abs(effort) >= SATURATED * torque_limit).any(axis=1)
    usable = ~(faulted | saturated)
    lines = []
    for what, bad in (('after a fault', faulted), ('motors saturated', saturated & ~faulted)):
        if bad.any():
            lines.append(f'{bad.sum() * np.median(np.diff(time)):.3g} s: {what}')
    return MeasuredMotion(time, position, effort, usable, tuple(lines))


def stretches(motion: MeasuredMotion, shortest: int) -> list[slice]:
    """Rows of a recording without gaps that can be used, each at least `shortest` rows long."""
    period = motion.period
    broken = ~motion.usable
    broken[1:] |= np.diff(motion.time) > GAP * period
    # A broken row ends a stretch; one after a gap begins the next, as its position is known.
    found = []
    edges = np.flatnonzero(broken)
    for begin, end in zip([0, *edges], [*edges, len(broken)], strict=True):
        first = begin if begin == 0 or motion.usable[begin] else begin + 1
        for part in range(first, end, LONGEST):
            rows = slice(int(part), int(min(part + LONGEST, end)))
            if rows.stop - rows.start >= shortest:
                found.append(rows)
    return found


def _faulted(stamps: NDArray[np.int64], statuses: Sequence[ControllerStatus]) -> NDArray[np.bool_]:
    """Which states were in a fault, shape (N,)."""
    if not statuses:
        return np.zeros(len(stamps), bool)
    begins = np.array([status.stamp for status in statuses])
    faulted = np.array([False, *(status.fault != NO_FAULT for status in statuses)])
    return faulted[np.searchsorted(begins, stamps, side='right')]
