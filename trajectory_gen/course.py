"""Motions one after another: a new one begins in the state in which the one before it is."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_base.errors import InputError
from trajectory_gen import preflight, waypoints
from trajectory_gen.motion_message import Points
from trajectory_gen.trajectory import Reference, Trajectory

KEPT = 100  # motions; of older ones the first is sampled instead


class Course:
    """Which motion the samples belong to. It does not change; `then` makes another one.

    Attributes:
        parts: Index of the sample at which each motion begins, and the motion. That sample still
            belongs to the motion before it.
    """

    def __init__(
        self, trajectory: Trajectory, period: float, parts: tuple[tuple[int, Trajectory], ...] = ()
    ) -> None:
        """Begin with a motion.

        Args:
            trajectory: The first motion.
            period: Time between samples [s].
            parts: Motions after it.
        """
        self._first = trajectory
        self._period = period
        self.parts = parts[-KEPT:]

    def prepare(self) -> None:
        """Load the machine code of new motions, which would hold up a loop that runs."""
        pose = self._first.sample(0.0).pose
        still = np.zeros((1, 6, pose.shape[1]))
        still[0, -1] = pose[0]
        self._first.along(waypoints.Spline(np.array([0.0, 1.0]), still, False)).sample(0.0)

    def sample(self, indices: Any) -> Reference:
        """Evaluate the motions at increasing indices of samples, shape (N,)."""
        indices = np.atleast_1d(indices)
        begins = [begin for begin, _ in self.parts]
        which = np.searchsorted(begins, indices)  # a sample at a beginning is of the one before
        found = []
        for k, (begin, trajectory) in enumerate([(0, self._first), *self.parts]):
            own = indices[which == k]
            if own.size:
                found.append(trajectory.sample((own - begin) * self._period))
        return (
            found[0]
            if len(found) == 1
            else Reference(*map(np.concatenate, zip(*found, strict=True)))
        )

    def then(self, index: int, points: Points) -> Course:
        """This course until a sample, then a motion through points, at last at rest.

        It is the motion of least mean square jerk through the points, or a quintic polynomial
        from each to the next where they have derivatives. Pose, rate and acceleration are
        continuous.

        Raises:
            InputError: the points are too uneven for that.
            MotionError: the robot cannot perform it.
        """
        before = Course(
            self._first, self._period, tuple(part for part in self.parts if part[0] < index)
        )
        spline = _spline(before.sample(index), points)
        trajectory = self._first.along(spline)
        preflight.check(trajectory, self._period)
        return Course(self._first, self._period, (*before.parts, (index, trajectory)))


def _spline(state: Reference, points: Points) -> waypoints.Spline:
    """The motion from a state through points.

    Raises:
        InputError: the points are too uneven.
    """
    from scipy import interpolate  # which takes long to load

    from trajectory_gen import spline

    times = np.concatenate([[0.0], points.times])
    pose = np.concatenate([state.pose, points.pose])
    if points.rate is None or points.acceleration is None:
        still = np.zeros(pose.shape[1])
        ends = (
            [(1, state.pose_rate[0]), (2, state.pose_acceleration[0])],
            [(1, still), (2, still)],
        )
        made = interpolate.make_interp_spline(times, pose, 5, bc_type=ends)
        coefficients = spline.polynomials(made, times)
    else:
        rate = np.concatenate([state.pose_rate, points.rate])
        acceleration = np.concatenate([state.pose_acceleration, points.acceleration])
        rows = np.stack([pose, rate, acceleration], axis=1)
        made = interpolate.BPoly.from_derivatives(times, rows)
        coefficients = interpolate.PPoly.from_bernstein_basis(made).c.transpose(1, 0, 2)
    offset = np.abs(made(times) - pose).max()
    if not offset <= waypoints.RESIDUAL * np.abs(pose).max():
        raise InputError('the times of the points are too uneven; leave some out')
    return waypoints.Spline(times, np.ascontiguousarray(coefficients), False)
