"""Figures of merit of a run: pure functions of its arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_analysis.run_log import RunLog
from parallel_robot_control.controller import first_guess
from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_interface import config
from parallel_robot_model.kinematics import pose_of
from parallel_robot_model.parameters import RobotParameters


class Errors(NamedTuple):
    """Tracking errors over a part of a run.

    Attributes:
        xy_rms_m: Root mean square distance of the platform from its reference [m].
        xy_max_m: Largest distance [m].
        joint_rms_rad: Root mean square joint error over all joints [rad].
        sync_rms_rad: Root mean square synchronisation error over all joints [rad].
    """

    xy_rms_m: float
    xy_max_m: float
    joint_rms_rad: float
    sync_rms_rad: float


class Torque(NamedTuple):
    """Motor torques over a whole run.

    Attributes:
        max_nm: Largest absolute torque of any joint [N m].
        total_variation_nm_per_s: Sum over the joints of |change of torque|, per second [N m/s].
    """

    max_nm: float
    total_variation_nm_per_s: float


class Metrics(NamedTuple):
    """All figures of a run; `steady` is its second half."""

    duration_s: float
    steady: Errors
    torque: Torque


class Poses(NamedTuple):
    """Platform poses by forward kinematics of joint angles [m, m, rad], each shape (N, 3)."""

    actual: np.ndarray
    reference: np.ndarray


def poses(log: RunLog) -> Poses:
    """Poses of the measured and of the desired joint angles, on the nominal robot.

    Raises:
        KinematicsError: a sample has no pose on the assembly mode of the scenario.
    """
    robot = config.group(log.config, RobotParameters, 'robot')
    guess = np.array(first_guess(log.config))
    reference = pose_of(robot, log.reference_position, guess)
    return Poses(pose_of(robot, log.position, reference[0]), reference)


def evaluate(log: RunLog, pose: Poses) -> Metrics:
    """Compute the figures of a run.

    Args:
        log: The run.
        pose: Its poses, see :func:`poses`.
    """
    half = slice(len(log.time) // 2, None)
    duration = float(log.time[-1] - log.time[0])
    distance = np.linalg.norm((pose.actual - pose.reference)[half, :2], axis=1)
    error = (log.reference_position - log.position)[half]
    variation = float(np.abs(np.diff(log.effort, axis=0)).sum())
    return Metrics(
        duration,
        Errors(
            _rms(distance),
            float(distance.max()),
            _rms(error),
            _rms(synchronisation_error(error)),
        ),
        Torque(float(np.abs(log.effort).max()), variation / duration if duration else 0.0),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
