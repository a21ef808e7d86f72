"""The check of a whole motion before its first message."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.errors import MotionError
from parallel_robot_model.planar_3rrr.singularity import condition_numbers
from trajectory_gen.trajectory import Reference, Trajectory, TrajectoryParameters

MOST_SAMPLES = 100_000  # of a motion that is checked


def check(trajectory: Trajectory, limits: TrajectoryParameters, period: float) -> None:
    """Refuse a motion that the robot cannot perform.

    Every sample of the motion, of a very long one MOST_SAMPLES, is checked for reach, both
    singularities and joint speed; only the first failure is reported.

    Args:
        trajectory: The motion.
        limits: What the robot must be spared.
        period: Time between samples [s].

    Raises:
        MotionError: with the time and the leg that fail, and the figure that would be allowed.
    """
    count = min(np.ceil(trajectory.span / period), MOST_SAMPLES)
    times = np.linspace(0.0, max(trajectory.span, count * period), int(count) + 1)
    reference = trajectory.sample(times)
    unreached = np.flatnonzero(reference.out_of_reach >= 0)
    reached = slice(0, int(unreached[0]) if unreached.size else None)
    found = [
        _type_1(reference, reached, limits),
        _type_2(trajectory, reference, reached, limits),
        _speed(reference, reached, limits),
    ]
    if unreached.size:
        k = int(unreached[0])
        robot = trajectory.robot
        reach = f'{abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m'
        found.append(
            (k, int(reference.out_of_reach[k]) + 1, f'out of reach (a leg spans {reach})')
        )
    failures = [failure for failure in found if failure is not None]
    if failures:
        k, leg, reason = min(failures, key=lambda failure: failure[0])
        raise MotionError(reason, float(times[k]), leg)


Failure = tuple[int, int | None, str] | None


def _type_1(reference: Reference, reached: slice, limits: TrajectoryParameters) -> Failure:
    sines = np.abs(np.sin(reference.beta[reached] - reference.position[reached]))
    return _first(
        sines < limits.min_sin_psi,
        sines,
        f'type 1 singularity, |sin psi| = {{:.3f}} is below {limits.min_sin_psi:g}',
    )


def _type_2(
    trajectory: Trajectory, reference: Reference, reached: slice, limits: TrajectoryParameters
) -> Failure:
    conditions = condition_numbers(
        trajectory.robot, reference.pose[reached, 2], reference.beta[reached]
    )
    return _first(
        conditions > limits.max_condition,
        conditions,
        f'type 2 singularity, cond(Jx) = {{:.3g}} is above {limits.max_condition:g}',
    )


def _speed(reference: Reference, reached: slice, limits: TrajectoryParameters) -> Failure:
    speeds = np.abs(reference.velocity[reached])
    return _first(
        speeds > limits.max_joint_speed,
        speeds,
        f'joint speed {{:.3g}} rad/s is above {limits.max_joint_speed:g} rad/s',
    )


def _first(bad: NDArray[np.bool_], values: NDArray[np.float64], text: str) -> Failure:
    """First sample that is bad; its leg where there is a column per leg."""
    if not bad.any():
        return None
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    return index[0], index[1] + 1 if len(index) == 2 else None, text.format(values[index])
