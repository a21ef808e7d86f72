"""A mechanism as lines: from joint to joint, to where loops close, and to the tool."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.mechanisms.mechanism import BASE, POINT, Index, Mechanism
from parallel_robot_model.mechanisms.postures import frames, postures
from parallel_robot_model.mechanisms.workspace import boxed

SHORT = 1e-6  # of the length of the mechanism: less is no line


class Line(NamedTuple):
    """A straight line of a link, from one of its points to another.

    Attributes:
        link: The joint that moves it, or BASE.
        ends: Both points in the frame of that joint [m], shape (2, 3).
    """

    link: int
    ends: Array


def lines(mechanism: Mechanism) -> tuple[Line, ...]:
    """The lines of all links: in each from its joint to all else that it carries."""
    tips: list[tuple[int, Array]] = [
        (int(parent), origin)
        for parent, origin in zip(mechanism.parent, mechanism.origin, strict=True)
    ]
    for k in np.flatnonzero(mechanism.closure == POINT):
        tips.append((int(mechanism.first[k]), mechanism.first_point[k]))
        tips.append((int(mechanism.second[k]), mechanism.second_point[k]))
    tips.append((int(mechanism.tool), mechanism.tool_point))
    found: dict[tuple[int, bytes], Line] = {}
    for link, tip in tips:
        if link != BASE and np.linalg.norm(tip) > SHORT * mechanism.length:
            found[link, np.round(tip, 9).tobytes()] = Line(link, np.stack([np.zeros(3), tip]))
    return tuple(found.values())


def positions_of(mechanism: Mechanism, q: Array) -> tuple[Array, Index]:
    """All joints at actuated ones, each posture from the one before, the first from home.

    Args:
        mechanism: The mechanism.
        q: Actuated joints [rad or m], shape (K, n).

    Returns:
        All joints, shape (K, N), NaN where there is a fault; the faults, shape (K,).
    """
    value, made = boxed(mechanism)
    given = np.ascontiguousarray(q, np.float64)
    positions = np.empty((len(given), len(mechanism.parent)))
    fault = np.zeros(len(given), np.int64)
    postures(value, made, given, positions, fault)
    return positions, fault


def drawn(mechanism: Mechanism, positions: Array) -> Array:
    """Ends of the lines of :func:`lines` in the world.

    Args:
        mechanism: The mechanism.
        positions: All joints [rad or m], shape (K, N).

    Returns:
        Shape (K, lines, 2, 3) [m].
    """
    count, joints = positions.shape
    rotation, origin = np.empty((count, joints, 3, 3)), np.empty((count, joints, 3))
    value, made = boxed(mechanism)
    frames(value, made, np.ascontiguousarray(positions), rotation, origin)
    found = [
        np.einsum('kab,eb->kea', rotation[:, line.link], line.ends)
        + origin[:, line.link, np.newaxis]
        for line in lines(mechanism)
    ]
    return np.stack(found, axis=1) if found else np.zeros((count, 0, 2, 3))
