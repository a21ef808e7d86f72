"""A reference motion in the joints of the robot."""

from __future__ import annotations

import copy
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.arrays import Array
from parallel_robot_base.errors import InputError
from parallel_robot_base.fields import Field
from parallel_robot_compiler import FirstClass, inlined, kernel, read_row, vector, write_row
from parallel_robot_model.contract import PoseMotion
from parallel_robot_model.robots import RobotModel
from trajectory_gen import shape_trial, waypoints
from trajectory_gen.shapes import SHAPES, Shape, prepared


class TrajectoryParameters(NamedTuple):
    """Which motion, how far ahead it is published, and how fast the joints may become."""

    shape: Annotated[str, Field('', f'the motion: {", ".join(SHAPES)}, or a custom one')]
    lookahead: Annotated[float, Field('s', 'how long before its stamp a sample is sent', 0.0, 0.5)]
    speed_factor: Annotated[
        float, Field('', 'how fast the motion runs; 2: twice as fast as its shape', 1e-6, 1e6)
    ]
    max_joint_speed: Annotated[float, Field('rad/s', 'largest joint speed allowed', 0.0)]


class Reference(NamedTuple):
    """Desired motion, one row per sample.

    Attributes:
        pose: Pose, shape (N, m); then its two derivatives.
        position: Actuated joints [rad], shape (N, n); then their two derivatives.
        passive: Other angles of the posture, see JointMotion, shape (N, p).
        out_of_reach: 0-based index of a part that does not reach, -1 if all do, shape (N,).
    """

    pose: Array
    pose_rate: Array
    pose_acceleration: Array
    position: Array
    velocity: Array
    acceleration: Array
    passive: Array
    out_of_reach: NDArray[np.int64]


class Trajectory:
    """A shape with its parameters on a robot.

    Attributes:
        robot: The robot.
        parameters: Which motion, and how it is published.
        limits: Limits of the motion that only this robot has.
        shape: What the shape computes the motion from: its parameters, or what it has prepared.
        span: Time after which nothing new happens [s].
    """

    def __init__(
        self,
        robot: RobotModel,
        parameters: TrajectoryParameters,
        limits: Any,
        shape: Shape,
        given: Any,
    ) -> None:
        """Prepare a motion.

        Args:
            robot: The robot.
            parameters: Which motion, and how it is published.
            limits: MotionLimits of the robot.
            shape: Its shape.
            given: Parameters of the shape.

        Raises:
            InputError: the shape refuses its parameters, or has another number of coordinates
                than the pose of the robot.
        """
        self.robot, self.parameters, self.limits = robot, parameters, limits
        name = parameters.shape
        if name not in SHAPES:
            shape_trial.check(name, shape, given)
        self.shape, self._length = prepared(name, shape, given)
        self.span = self._length / parameters.speed_factor
        self._motion = FirstClass(shape.motion, self.shape, 0.0)
        self._size = self.robot.pose_size
        size = len(shape.motion(self.shape, 0.0).pose)
        in_plane = self.robot.module.PLANAR and self._size < size == 3
        if size != self._size and not in_plane:
            names = ', '.join(
                axis.name for axis in self.robot.module.coordinates(self.robot.parameters)
            )
            raise InputError(
                f'trajectory.shape {name} has {size} coordinates; the pose of '
                f'{self.robot.name} has {self._size}: {names}',
                'trajectory.shape',
            )
        self._pose = vector(np.zeros(self._size))
        still = PoseMotion(self._pose, self._pose, self._pose)
        self._joints = self.robot.kernel('joint_motion', still)

    @property
    def first_pose(self) -> tuple[float, ...]:
        """The pose at which the motion begins, m numbers."""
        return tuple(self.sample(0.0).pose[0].tolist())

    def at_speed(self, factor: float) -> Trajectory:
        """The same motion at another ``trajectory.speed_factor``."""
        made = copy.copy(self)
        made.span = self._length / factor
        made.parameters = self.parameters._replace(speed_factor=factor)
        return made

    def along(self, spline: waypoints.Spline) -> Trajectory:
        """Another motion of the same robot, within the same limits, at its own speed."""
        made = copy.copy(self)
        made.shape, made.span = spline, waypoints.span(spline)
        made.parameters = self.parameters._replace(shape='waypoints', speed_factor=1.0)
        made._motion = FirstClass(waypoints.motion, spline, 0.0)
        return made

    def sample(self, times: Any) -> Reference:
        """Evaluate the motion.

        Args:
            times: Times since the start of the motion [s], a number or shape (N,).

        Returns:
            Pose and joints with two analytic derivatives each; NaN where the robot does not reach.
        """
        grid = np.atleast_1d(np.asarray(times, dtype=np.float64))
        robot = self.robot.constants
        speed = self.parameters.speed_factor
        return _sample(self._motion, self._joints, self.shape, robot, self._pose, grid, speed)


@kernel
def _sample(
    motion: Any,
    joint_motion: Any,
    shape: Any,
    robot: Any,
    like: Array,
    times: Array,
    speed: float,
) -> Reference:
    """Pose and joints at every time; `like` is any pose, `speed` that of the shape's time."""
    first = _at(motion, shape, like, 0.0, speed)
    joints = joint_motion(robot, first)
    count, size, n, p = len(times), len(like), len(joints.position), len(joints.passive)
    pose = np.empty((count, size))
    pose_rate = np.empty((count, size))
    pose_acceleration = np.empty((count, size))
    position = np.empty((count, n))
    velocity = np.empty((count, n))
    acceleration = np.empty((count, n))
    passive = np.empty((count, p))
    out_of_reach = np.empty(count, dtype=np.int64)
    for k in range(count):
        desired = _at(motion, shape, like, times[k], speed)
        joints = joint_motion(robot, desired)
        write_row(pose, k, desired.pose)
        write_row(pose_rate, k, desired.rate)
        write_row(pose_acceleration, k, desired.acceleration)
        write_row(position, k, joints.position)
        write_row(velocity, k, joints.velocity)
        write_row(acceleration, k, joints.acceleration)
        write_row(passive, k, joints.passive)
        out_of_reach[k] = joints.out_of_reach
    return Reference(
        pose,
        pose_rate,
        pose_acceleration,
        position,
        velocity,
        acceleration,
        passive,
        out_of_reach,
    )


@inlined
def _at(motion: Any, shape: Any, like: Array, time: float, speed: float) -> PoseMotion:
    """Motion at a time, as many coordinates as `like`: a robot in a plane may not have phi."""
    full = motion(shape, speed * time)
    return PoseMotion(
        read_row(full.pose, 0, like),
        speed * read_row(full.rate, 0, like),
        speed**2 * read_row(full.acceleration, 0, like),
    )
