"""What geometry alone costs: the error of joints that follow their reference exactly."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import known
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_sim.configuration import Configuration


def geometry_error(configuration: Configuration, times: Array) -> float:
    """Root mean square error of a robot whose joints seem to be where they should be.

    The references of the joints are those of the nominal robot; the true one stands elsewhere at
    them, and its encoders have zero angles. No law sees that from the joints.

    Args:
        configuration: The experiment.
        times: Times of the motion [s], shape (K,).

    Returns:
        That of the end effector's x and y [m], or of the joints without a plane [rad].

    Raises:
        KinematicsError: the true robot has no pose at some joints.
    """
    robot = configuration.plant.robot
    off = np.array(configuration.plant.imperfections.sensor.zero_angle)
    off = off - known(configuration.values)
    if not robot.place:
        return float(np.sqrt(np.mean(off**2)))
    desired = configuration.trajectory.sample(times)
    actual = poses_of(robot, desired.position - off, desired.pose[0])
    squares = ((actual - desired.pose)[:, : robot.place] ** 2).sum(axis=1)
    return float(np.sqrt(np.mean(squares)))
