"""The check of a whole motion before its first message."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.errors import MotionError
from parallel_robot_model.robots.feasibility import first_sample
from trajectory_gen.trajectory import Trajectory

MOST_SAMPLES = 100_000  # samples of a motion that are checked
ROUNDING = 1e-9  # of a mean speed, relative
AT_ONCE = 5000  # of them; between two such parts, other threads take their turn


def grid(trajectory: Trajectory, period: float) -> np.ndarray:
    """Times of the samples of a motion that are checked [s], shape (N,)."""
    count = min(np.ceil(trajectory.span / period), MOST_SAMPLES)
    return np.linspace(0.0, max(trajectory.span, count * period), int(count) + 1)


def check(trajectory: Trajectory, period: float) -> None:
    """Refuse a motion that the robot cannot perform.

    Every sample (of a very long motion, MOST_SAMPLES of them) is checked for joint speed and
    for what the robot itself forbids, e.g. singularities; only the first failure is reported.

    Args:
        trajectory: The motion.
        period: Time between samples [s].

    Raises:
        MotionError: it names the time, the part that fails and the allowed value.
    """
    times = grid(trajectory, period)
    for first in range(0, len(times), AT_ONCE):
        _check(trajectory, times[first : first + AT_ONCE + 1])  # the last is the next first


def _check(trajectory: Trajectory, times: np.ndarray) -> None:
    reference = trajectory.sample(times)
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
