"""Which pose a robot has where several fit its joints: its assembly modes.

The estimate follows the pose from state to state. Once it has had none, as at a type 2
singularity, the robot may be in another assembly mode, where the same joint angles mean another
pose: the pose is lost until the passive joints or the user tell it. Nothing here is in the loop.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import vector
from parallel_robot_model.messages.layouts import Reader, passive_names
from parallel_robot_model.robots.registry import RobotModel

GUESSES_PER_TURN = 8  # guesses on a turn of each angle of the pose
SHIFT = 0.4  # of the largest coordinate that is no angle: how far guesses lie beside it
SAME = 1e-6  # m or rad, between two poses that are one
CLOSE = 1e-2  # the same, where one is measured by other sensors


def pose_loss_mask(robot: RobotModel, margins: Any, position: Array, guess: Array) -> int:
    """Faults of the robot at which its pose is lost, as bits; none where joints have one pose.

    The robot names them in NO_POSE. Else they are all of its faults, unless its pose does not
    depend on the guess.

    Args:
        robot: The robot.
        margins: SafetyMargins of the robot.
        position: Any joint angles [rad], shape (n,).
        guess: Any pose, shape (m,).
    """
    faults = robot.module.NO_POSE
    if faults is None:
        one, other = (
            robot.module.estimate(robot.constants, margins, position, 0.0 * position, near).pose
            for near in (guess, 1.1 * guess + 0.1)
        )
        faults = () if np.array_equal(one, other) else robot.module.FAULTS
    return sum(1 << fault for fault in faults)


class AssemblyModes:
    """Finds the poses of a robot at its joint angles."""

    def __init__(self, configuration: ControlConfiguration) -> None:
        """Take the robot of a controller."""
        self._robot, self._margins = configuration.robot, configuration.margins
        self._joints = configuration.loop.joints
        self._zero_angle = np.array(configuration.estimator.zero_angle)
        axes = self._robot.module.coordinates(self._robot.parameters)
        self._names = [axis.name for axis in axes]
        self._turns = np.array([axis.unit == 'rad' for axis in axes])
        row, guess = np.zeros(len(self._joints)), np.array(configuration.guess)
        self._pose_loss_mask = pose_loss_mask(
            self._robot, self._margins, vector(row), vector(guess)
        )

    def near(self, position: Array, guess: Array) -> Array | None:
        """The pose at joint angles on the assembly mode of a guess, shape (m,); None without."""
        row = vector(position)
        robot, margins = self._robot, self._margins
        fault, pose, _ = robot.module.estimate(
            robot.constants, margins, row, 0.0 * row, vector(guess)
        )
        return None if (self._pose_loss_mask >> fault) & 1 else np.array(pose)

    def all(self, position: Array, near: Array) -> list[Array]:
        """Poses that fit joint angles, those found from guesses around one, the nearest first."""
        shift = SHIFT * float(np.abs(near[~self._turns]).max(initial=0.0))
        turns = 2.0 * math.pi / GUESSES_PER_TURN * np.arange(GUESSES_PER_TURN)
        steps = [turns if turn else (0.0, shift, -shift) for turn in self._turns]
        poses: list[Array] = []
        for step in itertools.product(*steps):
            pose = self.near(position, near + np.array(step))
            if pose is not None and all(self._distance(pose, other) > SAME for other in poses):
                poses.append(pose)
        return sorted(poses, key=lambda pose: self._distance(pose, near))

    def by_passive_joints(self, data: bytes) -> Array | None:
        """The pose that all joints in a state message tell, shape (m,); None without."""
        try:
            message = Reader(data)
            message.header()
            angles = dict(zip(message.texts(), message.numbers(), strict=True))
            measured = np.array([angles[joint] for joint in self._joints])
            passive = np.array([angles[joint] for joint in passive_names(self._joints)])
        except (KeyError, ValueError):  # not among them
            return None
        position = measured - self._zero_angle
        pose = self._robot.module.pose_with(self._robot.parameters, position, passive)
        return self.near(position, pose) if np.isfinite(pose).all() else None

    def is_same_mode(self, guess: Sequence[float], position: Array, pose: Array) -> bool:
        """Whether a pose is that which joint angles have on the assembly mode of a guess."""
        reached = self.near(position, np.array(guess))
        return reached is not None and self._distance(reached, pose) < CLOSE

    def text(self, poses: Sequence[Array]) -> str:
        """Some poses for people."""
        return ' or '.join(
            ', '.join(f'{name} {value:.4g}' for name, value in zip(self._names, pose, strict=True))
            for pose in poses
        )

    def _distance(self, pose: Array, other: Array) -> float:
        """Distance of two poses, m and rad alike."""
        way = pose - other
        turned = (way + math.pi) % (2.0 * math.pi) - math.pi
        return float(np.linalg.norm(np.where(self._turns, turned, way)))
