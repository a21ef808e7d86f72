"""What a browser gets thirty times a second: one picture of the motion as bytes.

A frame is 24 bytes, then float32: its length [bytes] and the number of its layout, both uint32;
time of the newest state [s] as float64; seconds that it covers [s] and points of the path, float32
and uint32. Then the posture: places of the reference, of the end effector, and of both ends of
each line of the robot [m], part by part; the points of the path: places of the reference and of
the end effector [m]; for each curve the extremes of its values, in the order in which they came. A
place is x, y, and z in space. Several frames may lie end to end in one message. Little endian.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.run.matching import reference_at
from parallel_robot_control.contract import JointReference
from parallel_robot_model.common.errors import KinematicsError
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

HEADER = struct.Struct('<IIdfI')
FRAME = 1.0 / 30.0  # s of motion in a frame
PATH_STEP = 0.02  # s between two points of the path


class Curve(NamedTuple):
    """A curve of the page."""

    group: str  # diagram in which it is drawn: error, joints, torque or ghost
    name: str  # name in the legend


class Motion(NamedTuple):
    """Some states of a robot, one row each."""

    time: Array  # since the first state [s], shape (N,)
    position: Array  # actuated joints [rad], shape (N, n)
    desired: Array  # their reference [rad], shape (N, n)
    effort: Array  # torques [N m], shape (N, n)
    ghost: Array  # torques that another law asks for [N m], NaN where there is none, shape (N, n)

    def part(self, rows: slice) -> Motion:
        """Some of them."""
        return Motion(*(row[rows] for row in self))


class Camera:
    """Turns states of one robot into frames."""

    def __init__(
        self, robot: RobotModel, guess: Array, joints: Sequence[str], number: int = 0
    ) -> None:
        """Prepare.

        Args:
            robot: The nominal robot.
            guess: A pose near the first one, shape (m,).
            joints: Names of the actuated joints.
            number: Of the layout.
        """
        self._robot, self._first = robot, guess
        self._guess = guess
        self.number = number  # of the layout; frames of another camera have another
        self.units = robot.joint_units  # units of the joints
        self.place = robot.place or len('xy')  # number of the coordinates of a place
        # parts of the robot, each name and number of lines; empty without a picture
        self.parts: list[tuple[str, int]] = []
        if robot.place:
            row = np.zeros(len(joints))
            found = robot.module.segments(robot.parameters, guess, row)
            self.parts = [(name, ends.shape[-3]) for name, ends in found.items()]
        groups = (['error'] if robot.place else []) + ['joints', 'torque', 'ghost']
        # what the frames hold after the path
        self.curves = [
            Curve(group, name)
            for group in groups
            for name in (['end effector'] if group == 'error' else joints)
        ]

    def begin(self) -> None:
        """Take the next states for those of another motion."""
        self._guess = self._first

    def frames(self, motion: Motion, seconds: float) -> list[bytes]:
        """Frames of at most about FRAME of motion each: several when the last look is long ago.

        Args:
            motion: The states, at least one.
            seconds: Time that they cover [s].
        """
        count = min(max(round(seconds / FRAME), 1), len(motion.time))
        edges = np.linspace(0, len(motion.time), count + 1).astype(int)
        return [
            self.frame(motion.part(slice(first, stop)), seconds * (stop - first) / edges[-1])
            for first, stop in pairwise(edges)
        ]

    def frame(self, motion: Motion, seconds: float) -> bytes:
        """The picture of the newest of some states, and the curves of all of them.

        Args:
            motion: The states, at least one.
            seconds: Time that they cover [s].
        """
        poses, desired = self._poses(motion)
        errors = motion.desired - motion.position
        place = self.place
        if self._robot.place:
            distance = np.linalg.norm((poses - desired)[:, :place], axis=1)[:, np.newaxis]
            values = np.hstack([distance, errors, motion.effort, motion.ghost])
            lines = self._lines(poses[-1], motion.position[-1])
            newest = [desired[-1, :place], poses[-1, :place], *lines]
            rows = _every(motion.time, PATH_STEP)
            path = np.hstack([desired[rows, :place], poses[rows, :place]])
        else:
            values = np.hstack([errors, motion.effort, motion.ghost])
            newest, path = [np.full(4, np.nan)], np.zeros((0, 4))
        numbers = np.concatenate([*newest, path.ravel(), _extremes(values).ravel()])
        body = numbers.astype('<f4').tobytes()
        length = HEADER.size + len(body)
        head = HEADER.pack(length, self.number, float(motion.time[-1]), seconds, len(path))
        return head + body

    def _lines(self, pose: Array, position: Array) -> list[Array]:
        found = self._robot.module.segments(self._robot.parameters, pose, position)
        return [ends.ravel() for ends in found.values()]

    def _poses(self, motion: Motion) -> tuple[Array, Array]:
        """Poses and desired poses, NaN where there are none, each shape (N, m)."""
        found = np.full((2, len(motion.time), len(self._first)), np.nan)
        if self._robot.place:
            for poses, joints in zip(found, (motion.position, motion.desired), strict=True):
                known = np.isfinite(joints).all(axis=1)
                poses[known] = self._located(joints[known])
            if np.isfinite(found[0, -1]).all():
                self._guess = found[0, -1]
        return found[0], found[1]

    def _located(self, joints: Array) -> Array:
        """Poses of some states, NaN where the robot is not where it was before, nor at first."""
        for guess in (self._guess, self._first):
            try:
                return poses_of(self._robot, joints, guess)
            except KinematicsError:
                continue
        return np.full((len(joints), len(self._first)), np.nan)


def _every(time: Array, step: float) -> NDArray[np.intp]:
    """The first row of each interval of time that begins among some rows, and the last row."""
    slots = np.floor(time / step + 1e-6)
    rows = np.flatnonzero(np.diff(slots, prepend=-np.inf) > 0)
    return np.union1d(rows[1:], [len(time) - 1]).astype(np.intp)


def _extremes(values: Array) -> Array:
    """Smallest and largest value of each column in the order of their rows, shape (columns, 2)."""
    known = np.where(np.isnan(values), np.inf, values)
    low = known.argmin(axis=0)
    high = np.where(np.isnan(values), -np.inf, values).argmax(axis=0)
    rows = np.sort(np.stack([low, high]), axis=0)
    return np.take_along_axis(values, rows, axis=0).T


# States and references as they come, put together into motion.

OLDEST = NANOSECONDS // 10  # ns, largest age of a reference that is still used
GAP = NANOSECONDS  # ns between two states, beyond which another motion begins
KEPT = 2000  # references


class States(NamedTuple):
    """Some states with their references, one row each."""

    stamps: NDArray[np.int64]  # [ns], shape (N,)
    position: Array  # [rad], shape (N, n)
    velocity: Array  # [rad/s], shape (N, n)
    effort: Array  # [N m], shape (N, n)
    # when the torques act, NaN where none is recent enough, each shape (N, n)
    references: JointReference
    desired: Array  # position of the reference at the stamps [rad], likewise, shape (N, n)
    anew: bool  # whether another motion begins with them


class MotionBuffer:
    """Keeps references until the states have come that need them."""

    def __init__(self, joints: int, age: int = 0) -> None:
        """Begin without any.

        Args:
            joints: Number of the actuated joints, n.
            age: From the measurement of a state to the torque that answers it [ns].
        """
        self._age = age
        self._last: int | None = None  # ns, stamp of the newest state
        self._known = np.zeros(0, dtype=np.int64)
        self._rows = JointReference(*(np.zeros((0, joints)) for _ in range(3)))

    def add_references(self, stamps: NDArray[np.int64], rows: tuple[Array, ...]) -> None:
        """Take references: stamps [ns], shape (M,); position and derivatives, shape (M, n)."""
        known = np.concatenate([self._known, stamps])
        back = np.flatnonzero(np.diff(known) <= 0)  # another motion, or another publisher
        kept = slice(max(int(back[-1]) + 1 if back.size else 0, len(known) - KEPT), None)
        self._known = known[kept]
        self._rows = JointReference(
            *(np.concatenate([old, new])[kept] for old, new in zip(self._rows, rows, strict=True))
        )

    def add_states(self, stamps: NDArray[np.int64], rows: tuple[Array, ...]) -> States | None:
        """Take states: stamps [ns], shape (N,); position, velocity, effort, each shape (N, n).

        Returns:
            Those of the newest motion; None without any.
        """
        if not len(stamps):
            return None
        before = stamps[0] - 1 if self._last is None else self._last
        steps = np.diff(stamps, prepend=before)
        breaks = np.flatnonzero((steps < 0) | (steps > GAP))
        first = int(breaks[-1]) if breaks.size else 0
        kept = np.flatnonzero(steps != 0)  # a plant repeats states in lockstep
        kept = kept[kept >= first]
        if not kept.size:
            return None
        stamps = stamps[kept]
        anew = bool(breaks.size) or self._last is None
        self._last = int(stamps[-1])
        position, velocity, effort = (row[kept] for row in rows)
        references, desired = self._at(stamps + self._age), self._at(stamps).position
        return States(stamps, position, velocity, effort, references, desired, anew)

    def _at(self, stamps: NDArray[np.int64]) -> JointReference:
        """References at some stamps [ns], NaN where none is recent enough."""
        if not len(self._known):
            none = np.full((len(stamps), self._rows.position.shape[1]), np.nan)
            return JointReference(none, none, none)
        found = reference_at(stamps, self._known, *self._rows)
        newest = np.searchsorted(self._known, stamps, side='right') - 1
        stale = (newest < 0) | (stamps - self._known[newest] > OLDEST)
        for row in found:
            row[stale] = np.nan
        return found
