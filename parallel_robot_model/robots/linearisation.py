"""A robot at rest in a pose as a linear system."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import vector
from parallel_robot_model.robots.contract import FOUND, REACHED, Model, PoseMotion
from parallel_robot_model.robots.poses import rates_of
from parallel_robot_model.robots.registry import RobotModel

SMALL = 1e-5  # rad, a step of the joints


class StateSpace(NamedTuple):
    """x' = A x + B u, y = C x + D u, for deviations from rest.

    The state x is the positions of the actuated joints [rad] and their rates [rad/s], the input u
    their torques beside those that hold the robot [N m], the output y the pose.

    Attributes:
        A: Shape (2n, 2n).
        B: Shape (2n, n).
        C: Shape (m, 2n).
        D: Zeros, shape (m, n).
    """

    A: Array
    B: Array
    C: Array
    D: Array


def linearise(robot: RobotModel, margins: Any, pose: Any, viscous: Any) -> StateSpace:
    """Linearise a robot at rest.

    M thdd + viscous thd + (d gravity / d theta) th = u, with M and gravity of the pose; the
    stiffness by gravity is a central difference, all else exact.

    Args:
        robot: The robot.
        margins: Its SafetyMargins.
        pose: The pose, m numbers.
        viscous: Viscous friction of the joints [N m s/rad], a number or shape (n,).

    Raises:
        InputError: the pose is out of reach, or violates a margin.
    """
    here = vector(robot.pose_of('pose', pose))
    zero = vector(np.zeros(len(here)))
    joint_motion = robot.kernel('joint_motion', PoseMotion(here, here, here))
    rest = joint_motion(robot.constants, PoseMotion(here, zero, zero))
    if rest.out_of_reach != REACHED:
        part = f'{robot.module.PARTS[0]} {rest.out_of_reach + 1}'
        raise InputError(f'pose {list(pose)} is out of reach of {part} of {robot.name}', 'pose')
    position = np.array(rest.position)
    n = len(position)
    still = vector(np.zeros(n))
    estimate = robot.kernel('estimate', margins, vector(position), still, here)

    def model(joints: Array) -> Model:
        estimated = estimate(robot.constants, margins, vector(joints), still, here)
        if estimated.fault != FOUND:
            raise InputError(
                f'pose {list(pose)} of {robot.name}: {robot.module.FAULTS[estimated.fault].text}',
                'pose',
            )
        return Model(*(np.array(part) for part in estimated.model))

    steps = SMALL * np.eye(n)
    rises = [model(position + step).gravity - model(position - step).gravity for step in steps]
    stiffness = np.transpose(rises) / (2.0 * SMALL)
    inertia, nothing = model(position).M, np.zeros((n, n))
    damping = np.diag(np.broadcast_to(np.asarray(viscous, dtype=np.float64), n))
    lower = np.linalg.solve(inertia, np.hstack([-stiffness, -damping, np.eye(n)]))
    return StateSpace(
        np.vstack([np.hstack([nothing, np.eye(n)]), lower[:, : 2 * n]]),
        np.vstack([nothing, lower[:, 2 * n :]]),
        np.hstack(
            [
                np.linalg.pinv(rates_of(joint_motion, robot.constants, here)),
                np.zeros((len(here), n)),
            ]
        ),
        np.zeros((len(here), n)),
    )
