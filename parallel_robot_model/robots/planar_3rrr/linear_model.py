"""The 3-RRR robot's equations of motion, linear in a, b, h of a leg and in Ip, mp of the platform.

tau = J^T (sum over the legs of H^T f_theta + K^T f_beta + platform), J = H^-1, with the forces of
dynamics.py in the coordinates (theta, beta) of a leg:

    f_theta = a thdd + h (cos psi betadd - sin psi betad^2)
    f_beta = b betadd + h (cos psi thdd + sin psi thd^2)

The platform joints of 120 degrees make one combination of the five invisible: mass moved from the
platform centre to its three joints, which belong to the distal links as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots import planar_links
from parallel_robot_model.robots.contract import Bodies
from parallel_robot_model.robots.planar_3rrr.kinematics import RobotParameters

OTHERS = ('Ip', 'mp')
NAMES = (
    'a = I1 + m1 lc1^2 + m2 l1^2, b = I2 + m2 lc2^2, h = m2 l1 lc2, all legs alike; '
    'Ip, mp: inertia and mass of the platform'
)


def units(robot: RobotParameters) -> dict[str, str]:
    """Names with units; the mass of the platform is regrouped into the others."""
    return {'a': 'kg m^2', 'b': 'kg m^2', 'h': 'kg m^2', 'Ip': 'kg m^2', 'mp': 'kg'}


def values(robot: RobotParameters) -> Array:
    """a, b, h, Ip, mp."""
    a = robot.I1 + robot.m1 * robot.lc1**2 + robot.m2 * robot.l1**2
    b = robot.I2 + robot.m2 * robot.lc2**2
    return np.array([a, b, robot.m2 * robot.l1 * robot.lc2, robot.Ip, robot.mp])


def bodies(robot: RobotParameters) -> Bodies:
    """The links of a leg and the platform."""
    a, h = {'J1': 1.0, 'm2': robot.l1**2}, {'h2': robot.l1}
    linear = [a, {'J2': 1.0}, h, {'Ip': 1.0}, {'mp': 1.0}]
    return planar_links.bodies(robot, OTHERS, linear, len(robot.base_x))


def parameters(robot: RobotParameters, numbers: Array) -> dict[str, Any]:
    """Masses, inertias and centres of mass."""
    return planar_links.parameters(robot, OTHERS, numbers)


def regressor(
    robot: RobotParameters, pose: Array, position: Array, velocity: Array, acceleration: Array
) -> Array:
    """Y at each sample, shape (N, 3, 5); arguments as in LinearModel.

    The closure C_i = E_i + l2 u(beta), with the platform joint C_i = P + l3 u(phi + gamma_i),
    projected on the distal link, then on its normal, and differentiated twice.
    """
    alpha = pose[:, 2:] + np.array(robot.platform_angle)
    theta, th_d, th_dd = position, velocity, acceleration
    to_platform_x = robot.l3 * np.cos(alpha)
    to_platform_y = robot.l3 * np.sin(alpha)
    base_x, base_y = np.array(robot.base_x), np.array(robot.base_y)
    beta = np.arctan2(
        pose[:, 1:2] + to_platform_y - base_y - robot.l1 * np.sin(theta),
        pose[:, 0:1] + to_platform_x - base_x - robot.l1 * np.cos(theta),
    )
    cos_psi, sin_psi = np.cos(beta - theta), np.sin(beta - theta)
    # 1. Along the link: Jx Xd = l1 sin(psi) thd, so J = Jx^-1 diag(l1 sin psi).
    along = np.stack([np.cos(beta), np.sin(beta), robot.l3 * np.sin(beta - alpha)], axis=-1)
    J = np.linalg.solve(along, np.eye(3) * (robot.l1 * sin_psi)[:, np.newaxis, :])
    X_d = np.einsum('tij,tj->ti', J, th_d)
    # 2. Across the link: l2 betad = across Xd - l1 cos(psi) thd.
    across = np.stack([-np.sin(beta), np.cos(beta), robot.l3 * np.cos(beta - alpha)], axis=-1)
    diagonal = np.eye(3) * (robot.l1 * cos_psi)[:, np.newaxis, :]
    beta_by_theta = (across @ J - diagonal) / robot.l2
    beta_d = np.einsum('tij,tj->ti', beta_by_theta, th_d)
    # 3. The same with accelerations.
    turn = robot.l3 * X_d[:, 2:] ** 2
    bias = turn * np.cos(beta - alpha) - robot.l1 * cos_psi * th_d**2 - robot.l2 * beta_d**2
    X_dd = np.linalg.solve(along, (robot.l1 * sin_psi * th_dd + bias)[..., np.newaxis])[..., 0]
    beta_dd = (
        np.einsum('tij,tj->ti', across, X_dd)
        + turn * np.sin(beta - alpha)
        - robot.l1 * (cos_psi * th_dd + sin_psi * th_d**2)
    ) / robot.l2
    # 4. Columns: what each parameter adds to the torques of the actuated joints.
    distal = np.swapaxes(beta_by_theta, 1, 2)
    h = cos_psi * beta_dd - sin_psi * beta_d**2 + np.einsum(
        'tij,tj->ti', distal, cos_psi * th_dd + sin_psi * th_d**2
    )  # fmt: skip
    b = np.einsum('tij,tj->ti', distal, beta_dd)
    Ip = J[:, 2] * X_dd[:, 2:]
    mp = J[:, 0] * X_dd[:, 0:1] + J[:, 1] * X_dd[:, 1:2]
    return np.stack([th_dd, b, h, Ip, mp], axis=-1)
