"""The arm as a tree of two links, the payload a part of the second."""

from __future__ import annotations

from typing import Any

from parallel_robot_model.common.units import Array
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.link import Link


def links(robot: Any, joints: tuple[str, ...]) -> tuple[Link, ...]:
    """Proximal link and distal link, which carries the payload."""
    payload = robot.mp
    mass = robot.m2 + payload
    centre = (robot.m2 * robot.lc2 + payload * robot.l2) / mass
    inertia = robot.I2 + robot.m2 * (centre - robot.lc2) ** 2 + payload * (robot.l2 - centre) ** 2
    proximal = (robot.m1, (robot.lc1, 0.0), robot.I1, (((0.0, 0.0), (robot.l1, 0.0)),))
    distal = (mass, (centre, 0.0), inertia, (((0.0, 0.0), (robot.l2, 0.0)),))
    return (
        Link('proximal', FRAME, joints[0], (0.0, 0.0), *proximal),
        Link('distal', 'proximal', joints[1], (robot.l1, 0.0), *distal),
    )


def angles(robot: Any, pose: Array, position: Array) -> Array:
    """Angles of its joints [rad], shape (..., 2)."""
    return position
