"""Motion of the joints for a motion of the platform."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, kernel, vector
from parallel_robot_model.robots.contract import REACHED, JointMotion, Measurement, PoseMotion
from parallel_robot_model.robots.planar_3rrr.dynamics import (
    apply,
    centripetal,
    rates_of,
    velocity_maps,
)
from parallel_robot_model.robots.planar_3rrr.geometry import (
    Constants,
    RobotParameters,
    constants,
    inverse_kinematics,
    out_of_reach,
    posture_at,
    theta_of,
)


@kernel
def joint_motion(robot: Constants, motion: PoseMotion) -> JointMotion:
    """Actuated angles with two derivatives: thetadd = H Xdd + H_dot Xdot; `passive` is beta."""
    posture = posture_at(robot, motion.pose)
    maps = velocity_maps(robot, posture)
    rates = rates_of(maps, motion.rate)
    theta, _ = centripetal(robot, posture, rates)
    return JointMotion(
        theta_of(robot, posture, motion.pose),
        rates.theta,
        apply(maps.H, motion.acceleration) + theta,
        np.arctan2(posture.sb, posture.cb),
        out_of_reach(posture),
    )


@kernel
def measure(robot: Constants, pose: Array, rate: Array) -> Measurement:
    """Joints at a pose and its rate, each shape (3,); passive angles in (-pi, pi]."""
    posture = posture_at(robot, pose)
    rates = rates_of(velocity_maps(robot, posture), rate)
    return Measurement(
        theta_of(robot, posture, pose),
        rates.theta,
        np.arctan2(posture.sin_psi, posture.cos_psi),
        rates.beta - rates.theta,
        pose,
    )


def start(robot: RobotParameters, pose: Array) -> Array:
    """The pose itself, shape (3,), if all legs reach it.

    Raises:
        InputError: a leg does not reach it.
    """
    boxed: Any = Boxed(constants(robot))  # as the other kernels take them
    leg = inverse_kinematics(boxed, vector(pose)).out_of_reach
    if leg != REACHED:
        raise InputError(
            f'plant.initial_pose {pose.tolist()} is out of reach of leg {leg + 1} '
            f'(a leg spans {abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m)',
            'plant.initial_pose',
        )
    return pose
