"""The check of a whole motion before its first message."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.errors import MotionError
from parallel_robot_model.robots.contract import first_sample
from trajectory_gen.trajectory import Reference, Trajectory

MOST_SAMPLES = 100_000  # samples of a motion that are checked
ROUNDING = 1e-9  # of a mean speed, relative
AT_ONCE = 5000  # of them; between two such parts, other threads take their turn


def grid(trajectory: Trajectory, period: float) -> np.ndarray:
    """Times of the samples of a motion that are checked [s], shape (N,)."""
    count = min(np.ceil(trajectory.span / period), MOST_SAMPLES)
    return np.linspace(0.0, max(trajectory.span, count * period), int(count) + 1)


def check(trajectory: Trajectory, period: float, known: Reference | None = None) -> None:
    """Refuse a motion that the robot cannot perform.

    Every sample (of a very long motion, MOST_SAMPLES of them) is checked for joint speed and
    for what the robot itself forbids, e.g. singularities; only the first failure is reported.

    Args:
        trajectory: The motion.
        period: Time between samples [s].
        known: Its first samples, one per period, which then are not computed again.

    Raises:
        MotionError: it names the time, the part that fails and the allowed value.
    """
    times = grid(trajectory, period)
    for first in range(0, len(times), AT_ONCE):
        part = times[first : first + AT_ONCE + 1]  # the last is the next first
        reference = known and _rows(known, first, part, period)
        _check(trajectory, part, reference or trajectory.sample(part))


def _rows(known: Reference, first: int, times: np.ndarray, period: float) -> Reference | None:
    """The rows from `first` on, if they are there and of exactly these times."""
    stop = first + len(times)
    if len(known.pose) < stop or not np.array_equal(times, np.arange(first, stop) * period):
        return None
    return Reference._make(each[first:stop] for each in known)


def _check(trajectory: Trajectory, times: np.ndarray, reference: Reference) -> None:
    robot, fastest = trajectory.robot, trajectory.parameters.max_joint_speed
    failures = robot.module.infeasible(robot.parameters, trajectory.limits, reference)
    unreached = np.flatnonzero(reference.out_of_reach >= 0)
    reached = slice(unreached[0] if unreached.size else None)
    speeds = np.abs(reference.velocity[reached])
    # What happens between two samples shows in their distance.
    steps = np.diff(reference.position[reached], axis=0) / np.diff(times[reached])[:, None]
    speeds[1:] = np.maximum(speeds[1:], (1.0 - ROUNDING) * np.abs(steps))
    text = 'joint speed {} rad/s is above trajectory.max_joint_speed, {} rad/s'
    too_fast = first_sample(speeds > fastest, speeds, text, fastest)
    if too_fast is not None:
        units = (
            robot.joint_units if too_fast.part is None else robot.joint_units.one(too_fast.part)
        )
        failures = [*failures, too_fast._replace(reason=units.of(too_fast.reason))]
    if failures:
        first = min(failures, key=lambda failure: failure.sample)
        where = robot.module.PARTS[first.part is None]
        raise MotionError(first.reason, float(times[first.sample]), where, first.part)
