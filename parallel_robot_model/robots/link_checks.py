"""Checks of the parameters of links: lengths, masses, inertias and centres of mass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from parallel_robot_model.common.errors import RobotError

CENTRES = (('lc1', 'l1'), ('lc2', 'l2'))  # keys: centre of mass of a link, and its length


def check_links(robot: Any, positive: Sequence[str], name: str) -> None:
    """Check a robot with a proximal and a distal link.

    Args:
        robot: Its parameters.
        positive: Keys that must be positive.
        name: Prefix of the keys in messages.

    Raises:
        RobotError: one of them is not positive, or a centre of mass lies outside its link.
    """
    for key in positive:
        if not getattr(robot, key) > 0.0:
            value, key = getattr(robot, key), f'{name}.{key}'
            raise RobotError(f'{key} must be positive, not {value:g}', key)
    for key, link in CENTRES:
        centre, length = getattr(robot, key), getattr(robot, link)
        if not 0.0 <= centre <= length:
            raise RobotError(
                f'{name}.{key} must lie on its link, from 0 to {link} = {length:g} m, '
                f'not {centre:g}',
                f'{name}.{key}',
            )
