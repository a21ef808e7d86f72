"""What a tracker should measure of a robot: as a function of all that a calibration looks for."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.studies.calibration.tracker import Locator, Tracker, Unknown
from parallel_robot_model.common.errors import BagError, InputError, ParallelRobotError, RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import parameters
from parallel_robot_model.robots.contract import Coordinate
from parallel_robot_model.robots.registry import RobotModel

# The parameters of a robot on which its forward kinematics depends, as a vector.

LOOKED_AT = 32  # poses at which it is looked whether a parameter counts
CHANGE = 1e-4  # of a parameter, in its unit
COUNTS = 1e-9  # change of a pose, in its units


class Number(NamedTuple):
    """One number of a robot's parameters."""

    key: str  # key of the parameter
    place: int | None  # its place in a list; None for a parameter that is a number
    unit: str
    what: str = ''  # what it is of, if its place does not say that

    @property
    def name(self) -> str:
        """How tables call it, e.g. ``robot.base_x[0]``."""
        place = '' if self.place is None else f'[{self.place}]'
        return f'robot.{self.key}{place} {self.what}'.rstrip()


def find_numbers(robot: RobotModel, position: Array, poses: Array) -> tuple[Number, ...]:
    """Parameters of a robot that move its pose at some joints.

    Args:
        robot: The robot.
        position: Actuated joints [rad], shape (N, n).
        poses: Their poses, shape (N, m).
    """
    rows = np.unique(np.linspace(0, len(position) - 1, LOOKED_AT).astype(int))
    exact, geometry = robot.module.pose_slopes, robot.module.geometry
    if exact is not None and geometry is not None:
        slopes = exact(robot.parameters, position[rows], poses[rows])[:, :, position.shape[1] :]
        moved = CHANGE * np.abs(slopes).max(axis=(0, 1)) > COUNTS
        key, names, unit = geometry(robot.parameters)
        return tuple(Number(key, int(k), unit, names[k]) for k in np.flatnonzero(moved))
    locate, found = Locator(robot), []
    for number in _numbers(robot):
        value = values_of(robot, [number])
        try:
            changed = with_values(robot, [number], value + CHANGE)
            moved = locate(changed, position[rows], poses[rows])
        except ParallelRobotError:  # a mode, which has no neighbour
            continue
        if moved is not None and np.abs(moved - poses[rows]).max() > COUNTS:
            found.append(number)
    return tuple(found)


def values_of(robot: RobotModel, numbers: Sequence[Number]) -> Array:
    """Values of some numbers of a robot, shape (P,)."""
    every = robot.parameters._asdict()
    return np.array(
        [
            every[each.key] if each.place is None else every[each.key][each.place]
            for each in numbers
        ],
        np.float64,
    )


def with_values(robot: RobotModel, numbers: Sequence[Number], given: Array) -> RobotModel:
    """A robot with other values of some numbers, shape (P,)."""
    changed = robot.parameters._asdict()
    for number, value in zip(numbers, given.tolist(), strict=True):
        if number.place is None:
            changed[number.key] = value
        else:
            entries = [*changed[number.key]]
            entries[number.place] = value
            changed[number.key] = type(changed[number.key])(entries)
    made = robot.module.validate(type(robot.parameters)(**changed), 'robot')
    return robot._replace(parameters=made)


def _numbers(robot: RobotModel) -> Iterator[Number]:
    for parameter in parameters(type(robot.parameters)):
        value = getattr(robot.parameters, parameter.key)
        for place, each in enumerate(value) if isinstance(value, tuple) else [(None, value)]:
            if isinstance(each, float):
                yield Number(parameter.key, place, parameter.field.unit)


NOISE = {'m': 1e-5, 'rad': 5e-5}  # of a good tracker, before its poses tell it
TOLD = {'m': 0.01, 'rad': 0.01, 's': 0.001}  # a combination that is known worse is not told
OF_TRACKER = 0.1  # how much what belongs to the tracker is to keep its value, beside the robot
STEP = 1e-6  # m or rad, half the width of a difference
CLOCK_STEP = 5e-3  # s, the same of the clock: noise of the joints must not count as motion


class JointTrack(NamedTuple):
    """Measured joints over time."""

    time: Array  # increasing [s], shape (M,)
    position: Array  # actuated joints as they were measured [rad], shape (M, n)

    def at(self, time: Array) -> Array:
        """Positions at some times, between the two next measurements [rad], shape (N, n)."""
        return np.column_stack([np.interp(time, self.time, row) for row in self.position.T])


class MeasuredPoses(NamedTuple):
    """Poses of a tracker."""

    time: Array  # when they were taken, by the clock of the joints [s], shape (N,)
    columns: tuple[int, ...]  # numbers of the coordinates that were measured, k of them
    pose: Array  # the coordinates, shape (N, k)

    def of(self, rows: np.ndarray) -> MeasuredPoses:
        """Some of them, by a mask or by their numbers."""
        return MeasuredPoses(self.time[rows], self.columns, self.pose[rows])


class PoseModel:
    """Measured poses as a function of geometry, zero angles and tracker."""

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
        """
        self.robot, self.joints, self.track, self.measured = robot, joints, track, measured
        self.watch: Callable[[int], None] = lambda _: None  # told how many robots were tried
        self._tried = 0
        self._differentiated: tuple[tuple[bytes, frozenset[int]], Array] | None = None
        self._tracker = Tracker(robot, measured.columns, free)
        self.units = self._tracker.units  # unit of each measured coordinate
        self._locate = Locator(robot)
        position = track.at(measured.time) - zero
        found = self._locate(robot, position, guesses)
        if found is None:
            raise InputError(f'the nominal {robot.name} has no pose at some of the joint angles')
        self.nominal = found  # poses of the nominal robot, shape (N, m)
        # the numbers of its geometry that count
        self.numbers: tuple[Number, ...] = find_numbers(robot, position, found)
        # all that is looked for: these, zero angles, what is free of the tracker, its clock
        self.unknown = (
            *(Unknown(each.name, each.unit) for each in self.numbers),
            *(
                Unknown(f'zero angle of {joint}', robot.joint_units.one(k).of('rad'))
                for k, joint in enumerate(joints)
            ),
            *self._tracker.unknown,
            Unknown('clock', 's'),
        )
        self.start = np.zeros(len(self.unknown))  # values that are believed before, shape (P,)
        self.start[: len(self.numbers)] = values_of(robot, self.numbers)
        self.start[self.zeros] = zero
        self.start[self._of_tracker] = self._tracker.start(found, measured.pose)

    def of(self, rows: Array) -> PoseModel:
        """The same of some of the poses, which a mask of shape (N,) tells."""
        part = copy.copy(self)
        part.measured = self.measured.of(rows)
        part.nominal = self.nominal[rows]
        part._differentiated = None
        return part

    @property
    def _of_tracker(self) -> slice:
        """Where what is free of the tracker stands among the unknown."""
        return slice(self.zeros.stop, self.zeros.stop + len(self._tracker.unknown))

    @property
    def zeros(self) -> slice:
        """Where the zero angles stand among the unknown."""
        first = len(self.numbers)
        return slice(first, first + self.track.position.shape[1])

    @property
    def axes(self) -> list[Coordinate]:
        """The measured coordinates."""
        every = self.robot.module.coordinates(self.robot.parameters)
        return [every[k] for k in self.measured.columns]

    @property
    def noise(self) -> Array:
        """Standard deviation of the coordinates by a good tracker, shape (k,)."""
        return np.array([NOISE[unit] for unit in self.units])

    @property
    def columns_by_unit(self) -> dict[str, list[int]]:
        """Which measured coordinates have which unit."""
        return by_unit(self.units)

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
        """The robot with some values of the unknown, shape (P,)."""
        return with_values(self.robot, self.numbers, values[: len(self.numbers)])

    def poses(self, values: Array) -> Array | None:
        """Poses of the robot in its own frame, shape (N, m); None where it has none."""
        self._tried += 1
        self.watch(self._tried)
        try:
            robot = self.robot_with(values)
        except RobotError:
            return None
        return self._locate(robot, self._position(values), self.nominal)

    def nominal_at(self, order: Sequence[int], signs: Array) -> Array | None:
        """Poses of the nominal robot, as :attr:`nominal`, with joints in another order or sign."""
        position = self._position(self.start)[:, order] * signs
        return self._locate(self.robot, position, self.nominal)

    def _position(self, values: Array) -> Array:
        """Joints at the poses [rad], shape (N, n)."""
        return self.track.at(self.measured.time - values[-1]) - values[self.zeros]

    def left(self, values: Array) -> Array | None:
        """Measured less predicted poses, shape (N, k); None where the robot has no pose.

        See :meth:`Tracker.apart`; the values of the unknown are of shape (P,).
        """
        poses = self.poses(values)
        if poses is None:
            return None
        predicted = self._tracker.seen(poses, values[self._of_tracker])
        return self._tracker.apart(self.measured.pose, predicted)

    def errors(self, values: Array) -> Array:
        """The same, where the robot must have all poses.

        Raises:
            BagError: it has none at some joints.
        """
        left = self.left(values)
        if left is None:
            raise unexplained()
        return left

    def slopes(self, values: Array, known: Collection[int] = ()) -> Array:
        """Derivatives of the predicted poses, shape (N, k, P); zero where the robot has none.

        Args:
            values: Of the unknown, shape (P,).
            known: Numbers of those by which it is not differentiated: zero.
        """
        asked = values.tobytes(), frozenset(known)
        if self._differentiated is not None and self._differentiated[0] == asked:
            return self._differentiated[1]  # the end of a search is the start of the next one
        found = np.zeros((*self.measured.pose.shape, len(values)))
        poses = self.poses(values)
        if poses is None:
            return found
        tracker = values[self._of_tracker]
        seen_by_pose = _slopes(
            lambda x: self._tracker.seen(poses + x, tracker), poses.shape[1], self._tracker.apart
        )
        of_robot = self._pose_slopes(values, poses, known)
        found[:, :, : self.zeros.stop] = seen_by_pose @ of_robot
        found[:, :, self._of_tracker] = _slopes(
            lambda x: self._tracker.seen(poses, tracker + x), len(tracker), self._tracker.apart
        )
        if len(values) - 1 not in known:
            ahead, back = (
                self.track.at(self.measured.time - values[-1] - step)
                for step in (CLOCK_STEP, -CLOCK_STEP)
            )
            of_joints = -found[:, :, self.zeros]
            rate = (ahead - back) / (2.0 * CLOCK_STEP)
            found[:, :, -1] = (of_joints @ rate[:, :, np.newaxis])[:, :, 0]
        found[:, :, list(known)] = 0.0
        self._differentiated = asked, found
        return found

    def _pose_slopes(self, values: Array, poses: Array, known: Collection[int]) -> Array:
        """Derivatives of the poses by geometry and zero angles, shape (N, m, P)."""
        exact = self.robot.module.pose_slopes
        if exact is not None:
            robot, n = self.robot_with(values), self.track.position.shape[1]
            slopes = exact(robot.parameters, self._position(values), poses)
            numbers = [n + (each.place or 0) for each in self.numbers]
            return np.concatenate([slopes[:, :, numbers], -slopes[:, :, :n]], axis=2)
        found = np.zeros((*poses.shape, self.zeros.stop))
        for k in set(range(self.zeros.stop)) - set(known):
            change = STEP * np.eye(1, len(values), k)[0]
            ahead, back = self.poses(values + change), self.poses(values - change)
            if ahead is not None and back is not None:
                found[:, :, k] = (ahead - back) / (2.0 * STEP)
        return found


def by_unit(units: Iterable[str]) -> dict[str, list[int]]:
    """Which of some numbers have which unit."""
    found: dict[str, list[int]] = {}
    for k, unit in enumerate(units):
        found.setdefault(unit, []).append(k)
    return found


def unexplained() -> BagError:
    """What is raised where a search does not end."""
    return BagError('no geometry was found that explains the poses: least squares do not end')


def _slopes(
    function: Callable[[Array], Array], count: int, apart: Callable[[Array, Array], Array]
) -> Array:
    """Derivatives of a function of some numbers at zero, by central differences."""
    steps = STEP * np.eye(count)
    columns = [apart(function(x), function(-x)) / (2.0 * STEP) for x in steps]
    return (
        np.stack(columns, axis=-1) if columns else np.zeros((*function(steps[:0].sum(0)).shape, 0))
    )
