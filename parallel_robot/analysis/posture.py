"""The joints of all links of a robot, passive ones too, from its actuated joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.errors import KinematicsError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import known
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.messages.topics import MARKERS_EVERY
from parallel_robot_model.robots.link import FIXED
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_model.robots.tree import angles_of, links_of, needs_pose, urdf


class Posture:
    """Follows the links of the nominal robot.

    Attributes:
        links: The links, L.
        moving: Which of them have a joint that moves, shape (L,).
        joints: Names of the joints that move.
        description: The robot as URDF.
    """

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
        self.links = links_of(robot, loop.joints)
        self.moving = np.array([link.kind != FIXED for link in self.links])
        self.joints = tuple(link.joint for link in self.links if link.kind != FIXED)
        self.description = urdf(robot.name, self.links)
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
    return Posture(*nominal_of(values), loop_of(values), known(values))
