"""What a machine moves: a frame of the description, and coordinates for its motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.parts import Description, Frame
from parallel_robot_model.mechanisms.description.tree import Tree

NAMES, UNITS = ('x', 'y', 'z', 'rx', 'ry', 'rz'), ('m',) * 3 + ('rad',) * 3
ORDER = (0, 1, 2, 5, 4, 3)  # in which coordinates are taken
APART = 0.02, 1e-4  # what makes a coordinate independent of those before, tried in this order


class Tool(NamedTuple):
    """The frame that is controlled.

    Attributes:
        name: Its name, or what it is.
        frame: On its link.
    """

    name: str
    frame: Frame


def named(description: Description, tree: Tree, name: str) -> Tool:
    """The frame of a name.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in description.frames:
        raise UnknownNameError('site, body or link', name, description.frames)
    return Tool(name, tree.on_link(description.frames[name]))


def coordinates(motion: Array) -> tuple[tuple[int, ...], tuple[tuple[str, str], ...]]:
    """The coordinates that describe where the tool is, where there are as many as freedoms.

    Args:
        motion: Rate of the tool and its angular rate, in one unit, by the n actuated joints,
            shape (6, n).

    Returns:
        Indices, 0 to 2 for x, y, z, 3 to 5 for the rotation, and names with units; both empty if
        the tool does not have n independent motions.
    """
    size = float(np.linalg.norm(motion, 2)) if motion.size else 0.0
    count = motion.shape[1]
    for apart in APART if size else ():
        chosen: list[int] = []
        for i in ORDER:
            if len(chosen) < count and _distance(motion[i], motion[chosen]) > apart * size:
                chosen.append(i)
        if len(chosen) == count:
            chosen.sort()
            plane = chosen == [0, 1, 5] and np.abs(motion[2:5]).max() < APART[1] * size
            names = ('x', 'y', 'phi') if plane else tuple(NAMES[i] for i in chosen)
            return tuple(chosen), tuple(
                (name, UNITS[i]) for name, i in zip(names, chosen, strict=True)
            )
    return (), ()


def _distance(row: Array, rows: Array) -> float:
    """Distance of a row from the space of others."""
    if not len(rows):
        return float(np.linalg.norm(row))
    left = row - np.linalg.lstsq(rows.T, row, rcond=None)[0] @ rows
    return float(np.linalg.norm(left))
