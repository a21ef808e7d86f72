"""Where a tracker stands and where its target sits, and what it sees of a pose by that."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, read_row, vector, write_row
from parallel_robot_model.robots.contract import FOUND
from parallel_robot_model.robots.registry import RobotModel

FRAME, TARGET = 'frame', 'target'
FREE = (FRAME, TARGET)  # what may be unknown of a tracker
ROUNDS = 10  # of leaving out poses
FEW = 4  # poses, which are not halved
STRAY = 4.0  # times the median distance, of a pose that does not count
LEAST = 0.01  # m and rad together, within which one counts in any case
PLACE, TURNS = ('x', 'y', 'z'), ('rx', 'ry', 'rz')  # in space


class Unknown(NamedTuple):
    """Something that a calibration looks for: its name and its unit."""

    name: str
    unit: str


class Tracker:
    """A tracker of a robot in a plane, in space, or of another one, of which nothing is free."""

    def __init__(
        self, robot: RobotModel, columns: tuple[int, ...], free: Collection[str] = ()
    ) -> None:
        """Prepare it.

        Args:
            robot: The robot.
            columns: Numbers of the coordinates that are measured.
            free: Which of FREE are unknown.
        """
        axes = robot.module.coordinates(robot.parameters)
        names = [axis.name for axis in axes]
        self.columns = columns  # numbers of the coordinates that it measures, k of them
        self.units = tuple(axes[k].unit for k in columns)  # their units
        self._free = [each for each in FREE if each in free]
        self._space = tuple(names) in (PLACE, PLACE + TURNS)
        if self._free and not (robot.axes == PLACE[:2] or self._space):
            raise InputError(
                f'--free {self._free[0]} is for robots that move in a plane, x-y, or in space '
                f'with no or three rotations; the pose of {robot.name} is {", ".join(names)}'
            )
        self._turns = 'phi' in names[2:3] or (self._space and len(names) > len(PLACE))
        if TARGET in self._free and not self._turns:
            what = 'a target cannot be told from the last link'
            raise InputError(f'--free target needs an angle phi: without it, {what}')
        # all rotations of a robot in space, among the measured coordinates
        self._rotations = [
            place for place, k in enumerate(columns) if self._space and k >= len(PLACE)
        ]
        self.unknown = tuple(self._names())  # what is looked for, Q of them

    def _names(self) -> list[Unknown]:
        found = []
        place, turns = (PLACE, TURNS) if self._space else (PLACE[:2], ('angle',))
        for each in self._free:
            found += [Unknown(f'{each}.{axis}', 'm') for axis in place]
            if each == FRAME or set(self.columns) >= {*range(len(place), len(place + turns))}:
                found += [Unknown(f'{each}.{axis}', 'rad') for axis in turns]
        return found

    def start(self, own: Array, measured: Array) -> Array:
        """The tracker that fits some poses of the robot, shape (N, m), to measured ones, (N, k).

        Poses that stray far from the others do not count.

        Returns:
            Shape (Q,).
        """
        near = np.ones(len(own), bool)
        for _ in range(ROUNDS if self._free else 0):  # of the nearest half
            off = self._off(own, measured, near)
            half = off <= np.sort(off)[max(len(off) // 2, min(len(off), FEW) - 1)]
            if (half == near).all():
                break
            near = half
        off = self._off(own, measured, near)
        near = off <= max(STRAY * float(np.median(off)), LEAST)
        return self._fitting(own[near], measured[near])

    def _off(self, own: Array, measured: Array, near: Array) -> Array:
        """How far poses are from what some of them tell, m and rad together, shape (N,)."""
        values = self._fitting(own[near], measured[near])
        off = self.apart(measured, self.seen(own, values))
        return np.asarray(np.linalg.norm(off, axis=1))

    def _fitting(self, own: Array, measured: Array) -> Array:
        """The same by all of these poses."""
        values = dict.fromkeys((each.name for each in self.unknown), 0.0)
        place = len(PLACE) if self._space else 2
        if FRAME in self._free and self.columns[:place] == tuple(range(place)):
            ours, seen = (
                np.pad(poses[:, :place], ((0, 0), (0, 3 - place))) for poses in (own, measured)
            )
            centres = ours.mean(axis=0), seen.mean(axis=0)
            turned = _aligned(ours - centres[0], seen - centres[1], self._space)
            vector, offset = turned.as_rotvec(), centres[1] - turned.apply(centres[0])
            found = [*offset, *vector] if self._space else [*offset[:2], vector[2]]
            names = [each.name for each in self.unknown if each.name.startswith(FRAME)]
            values.update(zip(names, map(float, found), strict=True))
        left = self.apart(measured, self.seen(own, np.array([*values.values()])))
        if 'target.angle' in values:
            turned_by = np.exp(1j * left[:, self.columns.index(2)]).mean()
            values['target.angle'] = float(np.angle(turned_by))
        if 'target.rx' in values:
            frame = Rotation.from_rotvec([values.get(f'frame.{axis}', 0.0) for axis in TURNS])
            believed = frame * Rotation.from_rotvec(own[:, 3:])
            seen_as = Rotation.from_rotvec(measured[:, self._rotations])
            mean = (believed.inv() * seen_as).mean().as_rotvec()
            values.update(zip((f'target.{axis}' for axis in TURNS), mean.tolist(), strict=True))
        return np.array([*values.values()])

    def seen(self, poses: Array, values: Array) -> Array:
        """What is measured at poses, shape (N, k).

        Args:
            poses: Poses in the frame of the robot, shape (N, m).
            values: Of the unknown, shape (Q,).
        """
        if not self._free:
            return poses[:, list(self.columns)]
        numbers = dict(zip((each.name for each in self.unknown), values.tolist(), strict=True))
        view = self._seen_in_space if self._space else self._seen_in_plane
        return view(poses, numbers)[:, list(self.columns)]

    def _seen_in_plane(self, poses: Array, tracker: dict[str, float]) -> Array:
        poses = poses.copy()
        if TARGET in self._free:
            poses[:, :2] += _turned(tracker['target.x'], tracker['target.y'], poses[:, 2])
            poses[:, 2] += tracker.get('target.angle', 0.0)
        if FRAME in self._free:
            angle = tracker['frame.angle']
            poses[:, :2] = _turned(poses[:, 0], poses[:, 1], angle)
            poses[:, :2] += tracker['frame.x'], tracker['frame.y']
            if self._turns:
                poses[:, 2] += angle
        return poses

    def _seen_in_space(self, poses: Array, tracker: dict[str, float]) -> Array:
        def read(name: str, axes: tuple[str, ...]) -> list[float]:
            return [tracker.get(f'{name}.{axis}', 0.0) for axis in axes]

        point = poses[:, :3]
        turned = Rotation.from_rotvec(poses[:, 3:] if self._turns else 0.0 * point)
        if TARGET in self._free:
            point = point + turned.apply(read(TARGET, PLACE))
            turned = turned * Rotation.from_rotvec(read(TARGET, TURNS))
        if FRAME in self._free:
            frame = Rotation.from_rotvec(read(FRAME, TURNS))
            point, turned = frame.apply(point) + read(FRAME, PLACE), frame * turned
        return np.concatenate([point, turned.as_rotvec()], axis=1)

    def apart(self, one: Array, other: Array) -> Array:
        """One less another measurement, shape (N, k): angles in (-pi, pi], rotations as a whole.

        Of three rotations it is the rotation vector that turns the other one into the first.
        """
        apart = one - other
        for k, unit in enumerate(self.units):
            if unit == 'rad':
                apart[:, k] -= 2.0 * np.pi * np.round(apart[:, k] / (2.0 * np.pi))
        if len(self._rotations) == len(TURNS):
            first, second = (Rotation.from_rotvec(x[:, self._rotations]) for x in (one, other))
            apart[:, self._rotations] = (first * second.inv()).as_rotvec()
        return apart


def _aligned(ours: Array, seen: Array, space: bool) -> Rotation:
    """The rotation that turns some directions best into others; in a plane, about z."""
    if space:
        return Rotation.align_vectors(seen, ours)[0]
    products = (ours[:, 0] - 1j * ours[:, 1]) * (seen[:, 0] + 1j * seen[:, 1])
    return Rotation.from_rotvec([0.0, 0.0, float(np.angle(products.sum()))])


def _turned(x: Array | float, y: Array | float, angle: Array | float) -> Array:
    """Points turned by an angle, shape (N, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x - s * y, s * x + c * y])


# Forward kinematics of many postures, each from a pose near its own.


class Locator:
    """Forward kinematics of robots of one kind, compiled once for all their parameters."""

    def __init__(self, robot: RobotModel) -> None:
        """Prepare it."""
        self._row = vector(np.zeros(robot.module.joints(robot.parameters)))
        self._like = vector(np.zeros(robot.pose_size))
        self._locate = robot.kernel('locate', self._row, self._like)

    def __call__(self, robot: RobotModel, position: Array, guesses: Array) -> Array | None:
        """Poses at joint positions.

        Args:
            robot: The robot.
            position: Actuated joints [rad], shape (N, n).
            guesses: Poses near the wanted ones, shape (N, m).

        Returns:
            Poses, shape (N, m); None where one has none.
        """
        row, like = self._row, self._like
        position, guesses = np.ascontiguousarray(position), np.ascontiguousarray(guesses)
        poses, whole = _located(self._locate, robot.constants, position, guesses, row, like)
        return poses if whole and np.isfinite(poses).all() else None


@kernel
def _located(
    locate: Any, robot: Any, position: Array, guesses: Array, row: Array, like: Array
) -> tuple[Array, bool]:
    """Poses, and whether all of them were found."""
    poses = np.empty((len(position), len(like)))
    for k in range(len(position)):
        found = locate(robot, read_row(position, k, row), read_row(guesses, k, like))
        if found.fault != FOUND:
            return poses, False
        write_row(poses, k, found.pose)
    return poses, True
