"""What a tracker should measure of a robot: as a function of all that a calibration looks for."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from parallel_robot.studies.calibration import geometry
from parallel_robot.studies.calibration.geometry import Number
from parallel_robot.studies.calibration.locating import Locator
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import InputError, RobotError
from parallel_robot_model.robots.registry import RobotModel

FRAME, TARGET = 'frame', 'target'
FREE = (FRAME, TARGET)  # what may be unknown of a tracker
TOLD = {'m': 0.01, 'rad': 0.01, 's': 0.001}  # a combination that is known worse is not told
OF_TRACKER = 0.1  # how much what belongs to the tracker is to keep its value, beside the robot
STEP = 1e-6  # m or rad, half the width of a difference
CLOCK_STEP = 5e-3  # s, the same of the clock: noise of the joints must not count as motion


class JointTrack(NamedTuple):
    """Measured joints over time.

    Attributes:
        time: Increasing [s], shape (M,).
        position: Actuated joints as they were measured [rad], shape (M, n).
    """

    time: Array
    position: Array

    def at(self, time: Array) -> Array:
        """Positions at some times, between the two next measurements [rad], shape (N, n)."""
        return np.column_stack([np.interp(time, self.time, row) for row in self.position.T])


class MeasuredPoses(NamedTuple):
    """Poses of a tracker.

    Attributes:
        time: When they were taken, by the clock of the joints [s], shape (N,).
        columns: Numbers of the coordinates that were measured, k of them.
        pose: The coordinates, shape (N, k).
    """

    time: Array
    columns: tuple[int, ...]
    pose: Array


class Unknown(NamedTuple):
    """Something that a calibration looks for: its name and its unit."""

    name: str
    unit: str


class PoseModel:
    """Measured poses as a function of geometry, zero angles and tracker.

    Attributes:
        robot: The nominal robot.
        numbers: The numbers of its geometry that count.
        unknown: All that is looked for: these, zero angles, what is free of the tracker, its
            clock.
        start: Values that are believed before, shape (P,).
        measured: The poses.
        units: Unit of each measured coordinate.
    """

    def __init__(
        self,
        robot: RobotModel,
        joints: tuple[str, ...],
        track: JointTrack,
        measured: MeasuredPoses,
        guesses: Array,
        zero: Array,
        free: Collection[str] = (),
    ) -> None:
        """Prepare it.

        Args:
            robot: The nominal robot.
            joints: Names of its joints.
            track: Their measured positions.
            measured: The measured poses.
            guesses: Poses of the nominal robot near these, shape (N, m).
            zero: Zero angles that are known before [rad], shape (n,).
            free: Which of FREE are unknown.

        Raises:
            InputError: the robot has nothing that is free, or its geometry does not fit.
        """
        self.robot, self.track, self.measured = robot, track, measured
        axes = robot.module.coordinates(robot.parameters)
        self.units = tuple(axes[k].unit for k in measured.columns)
        self._free = [each for each in FREE if each in free]
        if self._free and not robot.planar:
            raise InputError(f'--free {self._free[0]} is for robots that move in a plane')
        self._turns = robot.planar and len(axes) > 2 and axes[2].name == 'phi'
        if TARGET in self._free and not self._turns:
            what = 'a target cannot be told from the last link'
            raise InputError(f'--free target needs an angle phi: without it, {what}')
        self._locate = Locator(robot)
        position = track.at(measured.time) - zero
        found = self._locate(robot, position, guesses)
        if found is None:
            raise InputError(f'the nominal {robot.name} has no pose at some of the joint angles')
        self._guesses = found
        self.numbers: tuple[Number, ...] = geometry.find(robot, position, found)
        self.unknown = (
            *(Unknown(each.name, each.unit) for each in self.numbers),
            *(
                Unknown(f'zero angle of {joint}', robot.joint_units.one(k).of('rad'))
                for k, joint in enumerate(joints)
            ),
            *self._of_tracker(),
            Unknown('clock', 's'),
        )
        self.start = np.zeros(len(self.unknown))
        self.start[: len(self.numbers)] = geometry.values(robot, self.numbers)
        self.start[self.zeros] = zero
        self._place_tracker()

    def _of_tracker(self) -> list[Unknown]:
        """What is free of the tracker."""
        found = []
        for each in self._free:
            found += [Unknown(f'{each}.x', 'm'), Unknown(f'{each}.y', 'm')]
            if each == FRAME or 2 in self.measured.columns:
                found.append(Unknown(f'{each}.angle', 'rad'))
        return found

    def _place_tracker(self) -> None:
        """Begin with the tracker that fits the nominal robot best, where it is free."""
        names, columns = [each.name for each in self.unknown], self.measured.columns
        if FRAME in self._free and columns[:2] == (0, 1):
            own, seen = (
                poses[:, 0] + 1j * poses[:, 1] for poses in (self._guesses, self.measured.pose)
            )
            angle = float(np.angle(np.vdot(own - own.mean(), seen - seen.mean())))
            offset = seen.mean() - np.exp(1j * angle) * own.mean()
            first = names.index('frame.x')
            self.start[first : first + 3] = offset.real, offset.imag, angle
        if 'target.angle' in names:
            left = self.left(self.start)
            assert left is not None  # there are poses of the nominal robot
            turned = np.exp(1j * left[:, columns.index(2)]).mean()
            self.start[names.index('target.angle')] = float(np.angle(turned))

    @property
    def zeros(self) -> slice:
        """Where the zero angles stand among the unknown."""
        first = len(self.numbers)
        return slice(first, first + self.track.position.shape[1])

    @property
    def told(self) -> Array:
        """Standard errors from which on a combination is not told, shape (P,)."""
        return np.array([TOLD[each.unit] for each in self.unknown])

    @property
    def preference(self) -> Array:
        """How much each is to keep its value where the poses do not tell, shape (P,)."""
        found = np.ones(len(self.start))
        found[self.zeros.stop :] = OF_TRACKER
        return found

    def robot_with(self, values: Array) -> RobotModel:
        """The robot with some values of the unknown, shape (P,).

        Raises:
            RobotError: it cannot be built.
        """
        return geometry.with_values(self.robot, self.numbers, values[: len(self.numbers)])

    def predicted(self, values: Array) -> Array | None:
        """What should have been measured, shape (N, k); None where the robot has no pose.

        Args:
            values: Of the unknown, shape (P,).
        """
        poses = self.poses(values)
        if poses is None:
            return None
        tracker = dict(zip((each.name for each in self.unknown), values.tolist(), strict=True))
        if TARGET in self._free:
            arm = _turned(tracker['target.x'], tracker['target.y'], poses[:, 2])
            poses[:, :2] += arm
            poses[:, 2] += tracker.get('target.angle', 0.0)
        if FRAME in self._free:
            angle = tracker['frame.angle']
            poses[:, :2] = _turned(poses[:, 0], poses[:, 1], angle)
            poses[:, :2] += tracker['frame.x'], tracker['frame.y']
            if self._turns:
                poses[:, 2] += angle
        return poses[:, list(self.measured.columns)]

    def poses(self, values: Array) -> Array | None:
        """Poses of the robot in its own frame, shape (N, m); None where it has none."""
        try:
            robot = self.robot_with(values)
        except RobotError:
            return None
        position = self.track.at(self.measured.time - values[-1]) - values[self.zeros]
        return self._locate(robot, position, self._guesses)

    def left(self, values: Array) -> Array | None:
        """Measured less predicted, angles in (-pi, pi], shape (N, k)."""
        predicted = self.predicted(values)
        if predicted is None:
            return None
        left = self.measured.pose - predicted
        for k, unit in enumerate(self.units):
            if unit == 'rad':
                left[:, k] -= 2.0 * math.pi * np.round(left[:, k] / (2.0 * math.pi))
        return left

    def slopes(self, values: Array, known: Collection[int] = ()) -> Array:
        """Derivatives of the predicted poses by central differences, shape (N, k, P).

        Args:
            values: Of the unknown, shape (P,).
            known: Numbers of those by which it is not differentiated: zero.
        """
        found = np.zeros((*self.measured.pose.shape, len(values)))
        for k in set(range(len(values))) - set(known):
            step = CLOCK_STEP if k == len(values) - 1 else STEP
            change = step * np.eye(1, len(values), k)[0]
            ahead, back = self.predicted(values + change), self.predicted(values - change)
            if ahead is not None and back is not None:
                found[:, :, k] = (ahead - back) / (2.0 * step)
        return found


def _turned(x: Array | float, y: Array | float, angle: Array | float) -> Array:
    """Points turned by an angle, shape (N, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x - s * y, s * x + c * y])
