"""The 3-RRR as a tree: three legs, and the platform at the tip of the first."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.link import Beside, Closure, Link
from parallel_robot_model.robots.planar_3rrr.kinematics import RobotParameters, segments

PLATFORM = 'platform_joint'  # name of the joint between the first leg and the platform


def links(robot: RobotParameters, joints: tuple[str, ...]) -> tuple[Link, ...]:
    """Three proximal links, three distal links, and the platform, whose x axis is at phi."""
    base = list(zip(robot.base_x, robot.base_y, strict=True))
    points, centre = _corners(robot)
    proximal = [
        Link(
            *(f'proximal{k}', FRAME, joint, base[k - 1]),
            *(robot.m1, (robot.lc1, 0.0), robot.I1, (((0.0, 0.0), (robot.l1, 0.0)),)),
        )
        for k, joint in enumerate(joints, start=1)
    ]
    distal = [
        Link(
            *(f'distal{k}', f'proximal{k}', f'{joint}_passive', (robot.l1, 0.0)),
            *(robot.m2, (robot.lc2, 0.0), robot.I2, (((0.0, 0.0), (robot.l2, 0.0)),)),
        )
        for k, joint in enumerate(joints, start=1)
    ]
    sides = tuple((points[k], points[(k + 1) % 3]) for k in range(3))
    platform = Link(
        *('platform', 'distal1', PLATFORM, (robot.l2, 0.0)),
        *(robot.mp, (centre.real, centre.imag), robot.Ip, sides),
    )
    return (*proximal, *distal, platform)


def beside(robot: RobotParameters) -> Beside:
    """The other two legs end at corners of the platform."""
    corners = _corners(robot)[0]
    return Beside(
        tuple(
            Closure((f'distal{k}', 'platform'), ((robot.l2, 0.0), corners[k - 1])) for k in (2, 3)
        )
    )


def _corners(robot: RobotParameters) -> tuple[list[tuple[float, float]], complex]:
    """Corners of the platform from its first, and its centre, as x + iy [m]."""
    corners = robot.l3 * np.exp(1j * np.array(robot.platform_angle))
    points = [(corner.real, corner.imag) for corner in (corners - corners[0]).tolist()]
    return points, -complex(corners[0])


def angles(robot: RobotParameters, pose: Array, position: Array) -> Array:
    """Angles of its joints [rad], shape (..., 7): actuated, passive, platform."""
    ends = segments(robot, pose, position)['distal']
    x, y = np.moveaxis(ends[..., 1, :] - ends[..., 0, :], -1, 0)
    beta = np.arctan2(y, x)
    platform = pose[..., 2:3] - beta[..., :1]
    return np.concatenate([position, beta - position, platform], axis=-1)
