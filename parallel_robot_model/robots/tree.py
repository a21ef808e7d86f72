"""A robot as a tree of links that turn about z, for tools that know nothing else.

A robot module may have an attribute ``tree`` with two functions: ``links(parameters, joints)``,
the links, and ``angles(parameters, pose, position)``, those of their joints [rad], shape (..., L),
at poses, shape (..., m), and actuated joints, shape (..., n). Without it, the robot has no URDF
and no frames. A closed chain is cut open; its angles close it again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.robots.link import Link
from parallel_robot_model.robots.registry import RobotModel


def links_of(robot: RobotModel, joints: tuple[str, ...]) -> tuple[Link, ...]:
    """Links of a robot.

    Args:
        robot: The robot.
        joints: Names of its actuated joints.

    Raises:
        InputError: the robot has no ``tree``.
    """
    links: tuple[Link, ...] = _tree(robot).links(robot.parameters, joints)
    return links


def angles_of(robot: RobotModel, pose: Array, position: Array) -> Array:
    """Angles of the joints of all links [rad], shape (..., L), in [-pi, pi).

    Args:
        robot: The robot.
        pose: Poses, shape (..., m).
        position: Actuated joints [rad], shape (..., n).

    Raises:
        InputError: the robot has no ``tree``.
    """
    angles: Array = _tree(robot).angles(robot.parameters, pose, position)
    return np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi


def has_tree(robot: RobotModel) -> bool:
    """Whether a robot has links and angles."""
    return hasattr(robot.module, 'tree')


def _tree(robot: RobotModel) -> Any:
    if not has_tree(robot):
        raise InputError(f'{robot.name} says nothing of its links: it has no tree (docs/views.md)')
    module: Any = robot.module
    return module.tree
