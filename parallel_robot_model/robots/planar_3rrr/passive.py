"""The pose by all measured joints: actuated and passive ones, in whatever assembly mode."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.planar_3rrr.geometry import RobotParameters

CLOSED = 0.1  # of l3, how far a platform joint may be from where the others want it


def pose_with(robot: RobotParameters, position: Array, passive: Array) -> Array:
    """Pose at which the platform joints lie where the legs end, in the least squares.

    C_i = A_i + l1 u(theta_i) + l2 u(theta_i + psi_i) = P + l3 u(phi + gamma_i), which is linear in
    P and in exp(i phi) up to its length, with points of the plane as complex numbers.

    Args:
        robot: The robot.
        position: Actuated angles [rad], shape (3,).
        passive: Passive joints psi [rad], shape (3,).

    Returns:
        Pose (x, y, phi) [m, m, rad], shape (3,); NaN where the loops are not closed.
    """
    base = np.array(robot.base_x) + 1j * np.array(robot.base_y)
    elbow = base + robot.l1 * np.exp(1j * position)
    ends = elbow + robot.l2 * np.exp(1j * (position + passive))
    arms = robot.l3 * np.exp(1j * np.array(robot.platform_angle))
    from_centre = arms - arms.mean()
    phi = float(np.angle(np.vdot(from_centre, ends - ends.mean())))
    centre = (ends - np.exp(1j * phi) * arms).mean()
    gaps = np.abs(centre + np.exp(1j * phi) * arms - ends)
    closed = bool((gaps < CLOSED * robot.l3).all())
    return np.array([centre.real, centre.imag, phi]) if closed else np.full(3, np.nan)
