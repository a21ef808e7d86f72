"""The monitor without ROS: metrics over the last seconds of a motion."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import MotionPart, named
from parallel_robot.bags.run.matching import reference_at
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.errors import KinematicsError
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.configuration.fields import Field, given_zero_angles
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.mechanisms.joint_kinds import FIXED
from parallel_robot_model.messages.topics import DEPTH, MARKERS_EVERY
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_model.robots.tree import angles_of, beside_of, links_of, needs_pose, urdf
from parallel_robot_sim.motions import Motion, Poses

PERIOD = NANOSECONDS // 10  # ns of motion between two sets of metrics
OLDEST = NANOSECONDS // 10  # ns, largest age of a reference that is still used


class MonitorParameters(NamedTuple):
    """Over what the metrics are computed."""

    window: Annotated[float, Field('s', 'length of motion for the metrics', 0.1, 600.0)]


class WindowMetrics(NamedTuple):
    """Metrics over a window; the names are those of the topics, the units are SI.

    A robot whose pose is not a place has no end-effector error: its topics do not exist. That
    of one whose pose is a place is NaN while a sample of the window has no pose.
    """

    platform_error_rms: float
    platform_error_max: float
    joint_error_rms: float
    synchronisation_error_rms: float
    torque_max: float
    torque_variation: float
    torque_chattering: float


OF_TOPICS = (  # metrics of TABLE that they are
    'xy_rms_m',
    'xy_max_m',
    'joint_rms_rad',
    'sync_rms_rad',
    'torque_max_nm',
    'torque_total_variation_nm_per_s',
    'chattering_nm',
)


class _Window(NamedTuple):
    """Samples in order."""

    stamps: np.ndarray  # [ns], shape (N,)
    position: np.ndarray  # actuated joints [rad], shape (N, n)
    desired: np.ndarray  # [rad], shape (N, n)
    effort: np.ndarray  # torques [N m], shape (N, n)
    pose: np.ndarray  # of the joints, NaN where there is none, shape (N, m)
    desired_pose: np.ndarray  # shape (N, m)


class Monitor:
    """Collects states and references; computes metrics every 0.1 s of stamps.

    A stamp that jumps back, or ahead by more than the window, clears the window: a bag was
    rewound. States without a recent reference are left out: after a jump, the references received
    before it do not apply.
    """

    def __init__(self, robot: RobotModel, guess: Array, parameters: MonitorParameters) -> None:
        """Prepare.

        Args:
            robot: The nominal robot.
            guess: Pose from which its forward kinematics starts, shape (m,).
            parameters: Length of the window.
        """
        self._robot, self._first_guess = robot, guess
        self._planar = robot.place
        self._joints = robot.module.joints(robot.parameters)
        self._length = round(parameters.window * NANOSECONDS)
        self._newest: int | None = None  # ns, stamp of the last state
        self._references: deque[tuple[Any, ...]] = deque(maxlen=DEPTH)
        self._begin()

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the metrics that are defined for the robot."""
        return tuple(
            name
            for name in WindowMetrics._fields
            if self._planar or not name.startswith('platform')
        )

    def add_reference(self, stamp: int, motion: list[np.ndarray]) -> None:
        """Take a reference: stamp [ns]; position, velocity, acceleration, each shape (n,)."""
        if self._references and stamp <= self._references[-1][0]:
            self._references.clear()
        self._references.append((stamp, *motion))

    def add_state(
        self, stamp: int, position: np.ndarray, effort: np.ndarray
    ) -> WindowMetrics | None:
        """Take a state.

        Args:
            stamp: Stamp of the state [ns].
            position: Actuated joints [rad], shape (n,).
            effort: Torques, NaN where they are not known [N m], shape (n,).

        Returns:
            The metrics once in 0.1 s of motion; None otherwise, and while there are less than two
            states with a reference.
        """
        if self._newest is not None and not 0 < stamp - self._newest <= self._length:
            self._begin()
        due = self._newest is not None and stamp // PERIOD != self._newest // PERIOD
        self._newest = stamp
        self._states.append((stamp, position, effort))
        return self._evaluate() if due else None

    def _begin(self) -> None:
        self._guess = self._first_guess
        self._states: list[tuple[int, np.ndarray, np.ndarray]] = []
        rows, poses = np.empty((0, self._joints)), np.empty((0, len(self._guess)))
        self._window = _Window(np.empty(0, dtype=np.int64), rows, rows, rows, poses, poses)

    def _evaluate(self) -> WindowMetrics | None:
        """Metrics of the window, after new samples have moved into it."""
        new = self._new_samples()
        oldest = (self._newest or 0) - self._length
        kept = self._window.stamps >= oldest
        self._window = _Window(
            *(
                np.concatenate([old[kept], more])
                for old, more in zip(self._window, new, strict=True)
            )
        )
        if len(self._window.stamps) < 2:
            return None
        stamps, position, desired, effort, pose, desired_pose = self._window
        poses = Poses(pose, desired_pose, self._robot.place)
        part = MotionPart(Motion(stamps / NANOSECONDS, position, desired, effort, poses))
        return WindowMetrics._make(metric.value(part) for metric in named(*OF_TOPICS))

    def _new_samples(self) -> _Window:
        """Samples since the last metrics that have a recent reference."""
        references = [reference[0] for reference in self._references]
        states = [state for state in self._states if _has_recent(references, state[0])]
        self._states = []
        if not states:
            return self._window._replace(**{k: v[:0] for k, v in self._window._asdict().items()})
        stamps, position, effort = (np.array(column) for column in zip(*states, strict=True))
        known, *motion = (np.array(column) for column in zip(*self._references, strict=True))
        desired, _, _ = reference_at(stamps, known, *motion)
        while len(self._references) > 1 and self._references[1][0] <= stamps[-1]:
            self._references.popleft()
        return _Window(stamps, position, desired, effort, *self._poses(position, desired))

    def _poses(self, position: np.ndarray, desired: np.ndarray) -> tuple[Array, Array]:
        """Poses of the joints, and of the desired ones; NaN where there are none or no place."""
        nowhere = np.full((len(position), len(self._first_guess)), math.nan)
        if not self._planar:
            return nowhere, nowhere
        try:
            reference = poses_of(self._robot, desired, self._guess)
            actual = poses_of(self._robot, position, reference[0])
        except KinematicsError:
            return nowhere, nowhere
        self._guess = reference[-1]
        return actual, reference


def _has_recent(references: list[int], stamp: int) -> bool:
    """Whether one of the stamps, in order, is at or shortly before another [ns]."""
    newest = bisect.bisect_right(references, stamp) - 1
    return newest >= 0 and stamp - references[newest] <= OLDEST


# The joints of all links of a robot, passive ones too, from its actuated joints.


class Posture:
    """Follows the links of the nominal robot."""

    def __init__(
        self, robot: RobotModel, guess: Array, loop: LoopParameters, zero_angle: Array
    ) -> None:
        """Prepare.

        Args:
            robot: The nominal robot.
            guess: Pose from which its forward kinematics starts, shape (m,).
            loop: Names of its joints, period.
            zero_angle: What is taken off measured positions [rad], shape (n,).

        Raises:
            InputError: the robot says nothing of its links.
        """
        self._robot, self._zero_angle = robot, zero_angle
        self._first_guess = self._guess = guess
        self.links = links_of(robot, loop.joints)  # the links, L
        # which of them have a joint that moves, shape (L,)
        self.moving = np.array([link.kind != FIXED for link in self.links])
        # names of the joints that move
        self.joints = tuple(link.joint for link in self.links if link.kind != FIXED)
        # the robot as URDF
        self.beside = beside_of(robot)
        self.description = urdf(robot.name, self.links, loop.joints, self.beside)
        self._period = MARKERS_EVERY * loop.period_ns
        self._newest: int | None = None

    def add_state(self, stamp: int, position: np.ndarray) -> np.ndarray | None:
        """Take a state.

        Args:
            stamp: Stamp of the state [ns].
            position: Measured actuated joints [rad], shape (n,).

        Returns:
            Positions of the joints of all links [rad or m], shape (L,), fifty times in a second
            of motion; None otherwise, and where there is no pose.
        """
        due = self._newest is None or stamp // self._period != self._newest // self._period
        self._newest = stamp
        if not due:
            return None
        joints = (position - self._zero_angle)[np.newaxis]
        if needs_pose(self._robot):
            try:
                pose = poses_of(self._robot, joints, self._guess)
            except KinematicsError:  # it was put elsewhere
                self._guess = self._first_guess
                return None
            self._guess = pose[0]
        else:
            pose = joints
        angles = angles_of(self._robot, self.links, pose, joints)[0]
        return angles if np.isfinite(angles).all() else None


def posture_of(values: Mapping[str, Any]) -> Posture:
    """The posture of the nominal robot of a resolved configuration.

    Raises:
        InputError: a parameter is wrong, or the robot says nothing of its links.
    """
    return Posture(*nominal_of(values), loop_of(values), given_zero_angles(values))
