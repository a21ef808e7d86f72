"""A reference motion as the robot's joints see it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base import config
from parallel_robot_base.fields import Field
from parallel_robot_base.function_value import FirstClass
from parallel_robot_base.kernel import kernel
from parallel_robot_model.planar_3rrr.kinematics import inverse_kinematics, velocity_maps
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from trajectory_gen import circle, hold, line
from trajectory_gen.motion import PoseMotion

Array = NDArray[np.float64]


class Shape(Protocol):
    """A module with a motion: its parameters, the motion, and when it has shown everything."""

    Parameters: Any

    def motion(self, parameters: Any, t: float) -> PoseMotion:
        """Pose with two derivatives at time `t` [s]."""

    def span(self, parameters: Any) -> float:
        """Time after which nothing new happens [s]."""


SHAPES: dict[str, Shape] = {'circle': circle, 'line': line, 'hold': hold}


class TrajectoryParameters(NamedTuple):
    """Which motion, how far ahead it is published, and what the robot must be spared."""

    shape: Annotated[Literal['circle', 'line', 'hold'], Field('', 'the motion')]
    lookahead: Annotated[float, Field('s', 'how long before its stamp a sample is sent', 0.0, 0.5)]
    min_sin_psi: Annotated[float, Field('', 'smallest |sin psi| allowed (type 1)', 0.0, 1.0)]
    max_condition: Annotated[float, Field('', 'largest cond(Jx) allowed (type 2)', 1.0)]
    max_joint_speed: Annotated[float, Field('rad/s', 'largest joint speed allowed', 0.0)]


class Reference(NamedTuple):
    """Desired motion, one row a sample.

    Attributes:
        pose: (x, y, phi) [m, m, rad], shape (N, 3); then its two derivatives.
        position: Actuated angles [rad], shape (N, 3); then their two derivatives.
        beta: Distal angles [rad], shape (N, 3).
        out_of_reach: 0-based index of a leg that does not reach, -1 where all do, shape (N,).
    """

    pose: Array
    pose_rate: Array
    pose_acceleration: Array
    position: Array
    velocity: Array
    acceleration: Array
    beta: Array
    out_of_reach: NDArray[np.int64]


class Trajectory:
    """A shape with its parameters on a robot."""

    def __init__(self, robot: RobotParameters, shape: str, parameters: Any) -> None:
        """Prepare the motion `SHAPES[shape]` with its parameters for `robot`."""
        self.robot = robot
        self.parameters = parameters
        self.span = SHAPES[shape].span(parameters)
        self._motion = FirstClass(SHAPES[shape].motion, parameters, 0.0)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Trajectory:
        """Make the trajectory that a resolved configuration asks for."""
        shape = config.group(values, TrajectoryParameters, 'trajectory').shape
        robot = config.group(values, RobotParameters, 'robot')
        return cls(robot, shape, config.group(values, SHAPES[shape].Parameters, shape))

    def sample(self, times: Any) -> Reference:
        """Evaluate the motion.

        Args:
            times: Since the start of the motion [s], a number or shape (N,).

        Returns:
            Pose and joints with two analytic derivatives each; NaN where a leg does not reach.
        """
        grid = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return _sample(self._motion, self.parameters, self.robot, grid)


@kernel
def _sample(motion: Any, parameters: Any, robot: RobotParameters, times: Array) -> Reference:
    """thetadd = H Xdd + H_dot Xd at every time."""
    count = len(times)
    pose = np.empty((count, 3))
    pose_rate = np.empty((count, 3))
    pose_acceleration = np.empty((count, 3))
    position = np.empty((count, 3))
    velocity = np.zeros((count, 3))
    acceleration = np.zeros((count, 3))
    beta = np.empty((count, 3))
    out_of_reach = np.empty(count, dtype=np.int64)
    for k in range(count):
        desired = motion(parameters, times[k])
        legs = inverse_kinematics(robot, desired.pose)
        maps = velocity_maps(robot, desired.pose[2], legs.theta, legs.beta, desired.rate)
        for i in range(3):
            for j in range(3):
                velocity[k, i] += maps.H[i, j] * desired.rate[j]
                acceleration[k, i] += (
                    maps.H[i, j] * desired.acceleration[j] + maps.H_dot[i, j] * desired.rate[j]
                )
            pose[k, i] = desired.pose[i]
            pose_rate[k, i] = desired.rate[i]
            pose_acceleration[k, i] = desired.acceleration[i]
            position[k, i] = legs.theta[i]
            beta[k, i] = legs.beta[i]
        out_of_reach[k] = legs.out_of_reach
    return Reference(
        pose, pose_rate, pose_acceleration, position, velocity, acceleration, beta, out_of_reach
    )
