"""A robot as a tree of links, for tools that know nothing else.

A robot module may have an attribute ``tree`` with two functions: ``links(parameters, joints)``,
the links, and ``angles(parameters, pose, position)``, the positions of their joints [rad or m],
shape (..., L), at poses, shape (..., m), and actuated joints, shape (..., n). Links that are fixed
come last and have no positions. A tree with a true ``OF_JOINTS`` needs no poses. Without a tree,
the robot has no URDF and no frames. A closed chain is cut open; its angles close it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.link import TURNS, Link
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


def angles_of(robot: RobotModel, links: Sequence[Link], pose: Array, position: Array) -> Array:
    """Positions of the joints of all links [rad or m], shape (..., L), angles in [-pi, pi).

    Args:
        robot: The robot.
        links: Its links.
        pose: Poses, shape (..., m).
        position: Actuated joints [rad], shape (..., n).

    Raises:
        InputError: the robot has no ``tree``.
    """
    angles: Array = _tree(robot).angles(robot.parameters, pose, position)
    fixed = np.zeros((*angles.shape[:-1], len(links) - angles.shape[-1]))
    angles = np.concatenate([angles, fixed], axis=-1)
    turned = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
    return np.where([link.kind == TURNS for link in links], turned, angles)


def needs_pose(robot: RobotModel) -> bool:
    """Whether the positions of its joints need the pose."""
    return not getattr(_tree(robot), 'OF_JOINTS', False)


def has_tree(robot: RobotModel) -> bool:
    """Whether a robot has links and angles."""
    return hasattr(robot.module, 'tree')


def _tree(robot: RobotModel) -> Any:
    if not has_tree(robot):
        raise InputError(f'{robot.name} says nothing of its links: it has no tree (docs/views.md)')
    module: Any = robot.module
    return module.tree
