"""Motion of the joints for a motion of the platform."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.errors import InputError
from parallel_robot_base.kernel import kernel
from parallel_robot_base.linear_algebra import multiply
from parallel_robot_model.contract import JointMotion, Measurement, PoseMotion
from parallel_robot_model.planar_3rrr.kinematics import inverse_kinematics, velocity_maps
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]


@kernel
def joint_motion(robot: RobotParameters, motion: PoseMotion) -> JointMotion:
    """Actuated angles with two derivatives: thetadd = H Xdd + H_dot Xdot; `passive` is beta."""
    legs = inverse_kinematics(robot, motion.pose)
    maps = velocity_maps(robot, motion.pose[2], legs.theta, legs.beta, motion.rate)
    velocity = np.zeros(3)
    acceleration = np.zeros(3)
    for i in range(3):
        for j in range(3):
            velocity[i] += maps.H[i, j] * motion.rate[j]
            acceleration[i] += (
                maps.H[i, j] * motion.acceleration[j] + maps.H_dot[i, j] * motion.rate[j]
            )
    return JointMotion(legs.theta, velocity, acceleration, legs.beta, legs.out_of_reach)


@kernel
def measure(robot: RobotParameters, pose: Array, rate: Array) -> Measurement:
    """Joints at a pose and its rate, each shape (3,); passive angles in (-pi, pi]."""
    legs = inverse_kinematics(robot, pose)
    maps = velocity_maps(robot, pose[2], legs.theta, legs.beta, rate)
    theta_dot = multiply(maps.H, rate)
    psi = np.arctan2(np.sin(legs.beta - legs.theta), np.cos(legs.beta - legs.theta))
    psi_dot = multiply(maps.K, rate) - theta_dot
    return Measurement(legs.theta, theta_dot, psi, psi_dot, pose.copy())


def start(robot: RobotParameters, pose: Array) -> Array:
    """The pose itself, shape (3,), if all legs reach it.

    Raises:
        InputError: a leg does not reach it.
    """
    leg = inverse_kinematics(robot, pose).out_of_reach
    if leg >= 0:
        raise InputError(
            f'plant.initial_pose {pose.tolist()} is out of reach of leg {leg + 1} '
            f'(a leg spans {abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m)'
        )
    return pose
