"""Poses that a robot reaches from a first one along straight lines, as its motion limits allow."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import REACHED
from trajectory_gen.trajectory import Reference, Trajectory
from trajectory_gen.waypoints import Spline

SAMPLES = 200  # of a line that is looked at
FARTHEST = 1.5  # m or rad of a coordinate, the end of a line that nothing stops
SHARE = 0.5  # of the line up to what stops it: nearer to singularities, little more is told
EDGE = 0.98  # the same of lines between poses, in parts of what is left of it


def along(trajectory: Trajectory, first: Array, last: Array) -> Reference:
    """A straight line of poses, at an even rate, up to the first that is out of reach.

    Args:
        trajectory: Any motion of the robot, within the limits that hold.
        first: Where it begins, shape (m,).
        last: Where it ends, shape (m,).
    """
    return _line(trajectory, first, last).sample(np.linspace(0.0, 1.0, SAMPLES), beyond=False)


def joints(trajectory: Trajectory, pose: Array) -> Array:
    """Joints at a pose within reach [rad or m], shape (n,)."""
    return np.asarray(_line(trajectory, pose, pose).sample(0.0).position[0])


def _line(trajectory: Trajectory, first: Array, last: Array) -> Trajectory:
    coefficients = np.zeros((1, 6, len(first)))
    coefficients[0, 4:] = last - first, first
    return trajectory.along(Spline(np.array([0.0, 1.0]), coefficients, False))


def reached(trajectory: Trajectory, line: Reference) -> int:
    """How many samples of a line can be performed before the first that cannot."""
    failures = trajectory.robot.module.infeasible(
        trajectory.robot.parameters, trajectory.limits, line
    )
    lost = np.flatnonzero(line.out_of_reach != REACHED)
    return min([len(line.pose), *(each.sample for each in failures), *lost[:1].tolist()])


def is_clear(trajectory: Trajectory, centre: Array, first: Array, last: Array) -> bool:
    """Whether a straight line is as far within the limits as the candidates are.

    Args:
        trajectory: Any motion of the robot, within the limits that hold.
        centre: Pose around which they are, shape (m,).
        first: Where the line begins, shape (m,).
        last: Where it ends, shape (m,).
    """
    ends = (centre + (pose - centre) * EDGE / SHARE for pose in (first, last))
    return reached(trajectory, along(trajectory, *ends)) == SAMPLES


def candidates(trajectory: Trajectory, centre: Array, count: int, seed: int) -> Array:
    """Poses in all directions from a first one, up to the limits, shape (count, m).

    Every second one is at the end of its line, the others anywhere on it.
    """
    rng = np.random.default_rng(seed)
    found = np.empty((count, len(centre)))
    for k in range(count):
        direction = rng.normal(size=len(centre))
        direction *= FARTHEST / np.abs(direction).max()
        line = along(trajectory, centre, centre + direction)
        share = SHARE * (rng.uniform() if k % 2 else 1.0)
        part = share * max(reached(trajectory, line) - 1, 0) / (SAMPLES - 1)
        found[k] = centre + part * direction
    return found
