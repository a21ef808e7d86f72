"""The pose in which the robot is, from its joint states."""

from __future__ import annotations

from collections import Counter

import numpy as np

from parallel_robot_model.common.errors import InputError, KinematicsError
from parallel_robot_model.common.units import Array
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.joint_reader import JointReader
from parallel_robot_model.robots.poses import poses_of
from trajectory_gen.trajectory import Trajectory


class PresentPose:
    """Finds the pose of a robot from a joint state.

    Attributes:
        problem: Why it is not known, for people.
    """

    def __init__(self, near: Trajectory, joints: tuple[str, ...], zero_angle: Array) -> None:
        """Prepare to read joint states; the machine code is loaded here.

        Args:
            near: A motion that begins at a pose of the same assembly mode.
            joints: Names of the joints, in order.
            zero_angle: What is taken off measured positions [rad], shape (n,).

        Raises:
            InputError: the robot does not reach that pose.
        """
        guess = near.sample(0.0)
        self._robot, self._guess = near.robot, guess.pose[0]
        self._zero_angle = zero_angle
        self._unusable: Counter[str] = Counter()
        self._reader = JointReader(topics.JOINT_STATES, joints, ('position',), self._unusable)
        self.problem = f'no {topics.JOINT_STATES.name} yet'
        try:
            poses_of(self._robot, guess.position, self._guess)
        except KinematicsError:
            pose = self._guess.tolist()
            raise InputError(f'the robot does not reach {pose}, the guess of its pose') from None

    def read(self, data: bytes) -> tuple[float, ...] | None:
        """The pose at a serialised joint state, m numbers; None if it cannot be used."""
        self._unusable.clear()
        state = self._reader.read(data)
        if state is None:
            self.problem = ', '.join(self._unusable)
            return None
        _, (position,) = state
        try:
            joints = (position - self._zero_angle)[np.newaxis]
            (pose,) = poses_of(self._robot, joints, self._guess)
        except KinematicsError as error:
            self.problem = str(error)
            return None
        return tuple(pose.tolist())
