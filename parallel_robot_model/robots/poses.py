"""Poses of a robot from its joints, sample by sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, KinematicsError
from parallel_robot_model.common.units import Array, beyond_a_turn
from parallel_robot_model.compiler import kernel, read_row, vector, write_row
from parallel_robot_model.robots.contract import FOUND, REACHED, Model, PoseMotion
from parallel_robot_model.robots.registry import RobotModel


def poses_of(
    robot: RobotModel, position: Array, guess: Array, any_mode: bool = False, first: int = 0
) -> Array:
    """Forward kinematics of a series of samples, each with the previous pose as its guess.

    Args:
        robot: The robot.
        position: Actuated joints [rad], shape (N, n).
        guess: A pose near the first one, shape (m,).
        any_mode: Whether a robot whose joints have one pose, as its NO_POSE says, may be in any
            fault.
        first: Number of the first sample, for who reads what is raised.

    Returns:
        Poses, shape (N, m).

    Raises:
        KinematicsError: no pose fits.
    """
    joints = np.ascontiguousarray(position, dtype=np.float64)
    row, start = vector(np.zeros(joints.shape[1])), vector(guess)
    locate = robot.kernel('locate', row, start)
    faults = robot.module.NO_POSE if any_mode else None
    if faults == ():
        return _all_poses(locate, robot.constants, joints, row, start)
    poses, failed, fault = _poses(locate, robot.constants, joints, row, start)
    if fault != FOUND:
        far = beyond_a_turn(joints[failed : failed + 1], robot.joint_units)
        raise KinematicsError(
            f'forward kinematics: {robot.module.FAULTS[fault].text} (sample {first + failed}, '
            f'joints at {np.round(joints[failed], 4).tolist()} {robot.joint_units.of("rad")})'
            + (f'; a joint is at {far}' if far else '')
        )
    return poses


def rates_of(joint_motion: Any, robot: Any, pose: Any) -> Array:
    """Rates of the joints for a unit rate of each coordinate of the pose, shape (n, m).

    Args:
        joint_motion: The robot's kernel of that name.
        robot: Its constants.
        pose: A pose, a vector of shape (m,).
    """
    units = (vector(row) for row in np.eye(len(pose)))
    still = vector(np.zeros(len(pose)))
    moved = (joint_motion(robot, PoseMotion(pose, unit, still)).velocity for unit in units)
    return np.array([np.asarray(velocity) for velocity in moved]).T


@kernel
def _poses(
    locate: Any, robot: Any, position: Array, row: Array, guess: Array
) -> tuple[Array, int, int]:
    """Poses, and the first sample without a pose with its fault."""
    poses = np.empty((len(position), len(guess)))
    for k in range(len(position)):
        location = locate(robot, read_row(position, k, row), guess)
        if location.fault != FOUND:
            return poses, k, location.fault
        write_row(poses, k, location.pose)
        guess = location.pose
    return poses, -1, FOUND


@kernel
def _all_poses(locate: Any, robot: Any, position: Array, row: Array, guess: Array) -> Array:
    """Poses of a robot whose joints have one pose, whatever the fault."""
    poses = np.empty((len(position), len(guess)))
    for k in range(len(position)):
        write_row(poses, k, locate(robot, read_row(position, k, row), guess).pose)
    return poses


# A robot at rest in a pose as a linear system.

SMALL = 1e-5  # rad, a step of the joints


class StateSpace(NamedTuple):
    """x' = A x + B u, y = C x + D u, for deviations from rest.

    The state x is the positions of the actuated joints [rad] and their rates [rad/s], the input u
    their torques beside those that hold the robot [N m], the output y the pose.
    """

    A: Array  # shape (2n, 2n)
    B: Array  # shape (2n, n)
    C: Array  # shape (m, 2n)
    D: Array  # zeros, shape (m, n)


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
