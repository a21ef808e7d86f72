"""States of a run near the times at which poses were measured, from its windows."""

from __future__ import annotations

import numpy as np

from parallel_robot.bags.messages.message_arrays import FIRST
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.studies.calibration.pose_model import JointTrack
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

KEPT = 1_000_000  # states that are kept; of a run with more, those near the poses


def margin(duration: float, states: int, poses: int) -> float:
    """How far from a pose states are kept [s], so that of all poses there are at most KEPT.

    Args:
        duration: Length of the run [s].
        states: How many states it has, about.
        poses: How many poses were measured.
    """
    if states <= KEPT or not poses:
        return np.inf
    return 0.5 * KEPT / poses * duration / states


class NearStates:
    """Collects states near some times, with the poses that the nominal robot has there.

    Attributes:
        first: Time of the first state [s]; NaN before it came.
        last: That of the last one.
        around: Time between the states before and after each pose [s]; NaN where there are none,
            shape (N,).
        period: Time between two states [s]; 0 where there are no two.
    """

    def __init__(
        self, robot: RobotModel, guess: Array, zero: Array, time: Array, margin: float
    ) -> None:
        """Begin without states.

        Args:
            robot: The nominal robot.
            guess: Pose near its first one, shape (m,).
            zero: Zero angles that are known [rad], shape (n,).
            time: Increasing times of the poses [s], shape (N,).
            margin: How far from them states are kept [s].
        """
        self._robot, self._guess, self._zero = robot, guess, zero
        self._time, self._margin = time, margin
        self._count, self._newest = 0, FIRST
        self._parts: list[tuple[Array, Array, Array]] = []
        self.first = self.last = np.nan
        self.around = np.full(len(time), np.nan)
        self.period = 0.0

    def add(self, log: RunLog) -> None:
        """Take the next window.

        Raises:
            KinematicsError: a state has no pose.
        """
        newest = np.maximum.accumulate(np.append(self._newest, log.stamps))
        newer = log.stamps > newest[:-1]  # each stamp once
        self._newest = int(newest[-1])
        time, position = log.time[newer], log.position[newer]
        if not len(time):
            return
        pose = poses_of(self._robot, position - self._zero, self._guess, first=self._count)
        self._guess, self._count = pose[-1], self._count + len(time)
        begins = np.isnan(self.first)
        states = time if begins else np.append(self.last, time)
        steps = np.diff(states)
        if len(steps):
            self.period = self.period or float(np.median(steps))
            after = np.searchsorted(states, self._time)
            inside = (after > 0) & (after < len(states))
            inside |= begins & (self._time == states[0])
            self.around[inside] = steps[np.maximum(after[inside], 1) - 1]
        self.first, self.last = (time[0] if begins else self.first), time[-1]
        low = np.searchsorted(self._time, time - self._margin, side='left')
        high = np.searchsorted(self._time, time + self._margin, side='right')
        near = high > low
        self._parts.append((time[near], position[near], pose[near]))

    def track(self) -> tuple[JointTrack, Array]:
        """The states that were kept, and the nominal poses there, shape (M, m)."""
        time, position, pose = (np.concatenate(each) for each in zip(*self._parts, strict=True))
        return JointTrack(time, position), pose
