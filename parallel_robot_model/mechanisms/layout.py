"""What follows from a mechanism once and for all: columns, units, groups of closures."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.mechanism import (
    BASE,
    COUPLING,
    POINT,
    SLIDE,
    Index,
    Mechanism,
)

NO_COORDINATE = -1  # in place of a coordinate: an axis along none
HELD = -1  # in place of a column: a joint that is neither actuated nor passive
GRID = 2.0**-24  # rad; of slides: times the power of two nearest to the length


class Layout(NamedTuple):
    """Tables of a mechanism of N joints, r closures and n actuated joints.

    Attributes:
        column: Column of each joint among the passive ones, from 0, or the actuated ones, from r,
            or HELD, shape (N,).
        passive: Passive joints in the order of their columns, those with few closures first, so
            that elimination fills little, shape (r,).
        moving: Joints that are not held, in their order, shape (n + r,).
        scale: Unit of a joint: the length for slides, 1 for hinges, shape (N,).
        grid: What positions are rounded to, shape (N,).
        group: First closure of each group that shares its points, then r, shape (groups + 1,).
        normal: Direction of each closure in units that make its error a number, shape (r, 3).
        unit: What makes the error of a coupling a number, shape (r,).
        along: Which coordinate axis of its frame a joint has as its axis, 0 to 2, or
            NO_COORDINATE, shape (N,).
        parallel: Whether its frame has the directions of that before at position zero, shape
            (N,).
        concentric: Whether its frame has the origin of that before, shape (N,).
        carries: Whether a joint moves the tool, shape (N,).
        rotations: Number of rotation coordinates of the pose.
        turns: The only one, 3 to 5, or 0.
    """

    column: Index
    passive: Index
    moving: Index
    scale: Array
    grid: Array
    group: Index
    normal: Array
    unit: Array
    along: Index
    parallel: Index
    concentric: Index
    carries: Index
    rotations: int
    turns: int


def layout(mechanism: Mechanism) -> Layout:
    """Tables of a mechanism."""
    m = mechanism
    slides = m.kind == SLIDE
    scale = np.where(slides, m.length, 1.0)
    passive = m.passive[np.argsort(_closures_on(m)[m.passive], kind='stable')]
    column = np.full(len(m.parent), HELD)
    column[passive] = np.arange(len(passive))
    column[m.actuated] = len(passive) + np.arange(len(m.actuated))
    first_slides = (m.first != BASE) & slides[m.first]
    lengths = (m.closure == POINT) | ((m.closure == COUPLING) & first_slides)
    unit = np.where(lengths, 1.0 / m.length, 1.0)
    rotations = m.coordinate[m.coordinate >= 3]
    return Layout(
        column,
        passive,
        np.flatnonzero(column != HELD),
        scale,
        np.where(slides, GRID * 2.0 ** round(math.log2(m.length)), GRID),
        np.array([k for k in range(len(m.closure) + 1) if not _same_points(m, k)]),
        m.direction * unit[:, np.newaxis],
        unit,
        _along(m.axis),
        (m.rotation == np.eye(3)).all(axis=(1, 2)).astype(np.int64),
        (m.origin == 0.0).all(axis=1).astype(np.int64),
        _before(m, m.tool),
        len(rotations),
        int(rotations[0]) if len(rotations) == 1 else 0,
    )


def _along(axis: Array) -> Index:
    """Which coordinate axis a joint has, 0 to 2, or NO_COORDINATE, shape (N,)."""
    found = (np.count_nonzero(axis, axis=1) == 1) & (axis.max(axis=1) == 1.0)
    return np.where(found, axis.argmax(axis=1), NO_COORDINATE)


def _before(m: Mechanism, joint: int) -> Index:
    """Whether a joint is on the chain that ends with `joint`, shape (N,)."""
    found = np.zeros(len(m.parent), np.int64)
    while joint != BASE:
        found[joint] = 1
        joint = int(m.parent[joint])
    return found


def _closures_on(m: Mechanism) -> Index:
    """Number of the closures that a joint is a part of, shape (N,)."""
    count = np.zeros(len(m.parent), np.int64)
    for kind, first, second in zip(m.closure, m.first, m.second, strict=True):
        if kind == COUPLING:
            count[[joint for joint in (first, second) if joint != BASE]] += 1
        else:
            count += _before(m, int(first)) | _before(m, int(second))
    return count


def _same_points(m: Mechanism, k: int) -> bool:
    """Whether closure k has the joints and points of that before."""
    if k in (0, len(m.closure)) or m.closure[k] == COUPLING:
        return False
    fields = (m.closure, m.first, m.second, m.first_point, m.second_point, m.turned)
    return all(np.array_equal(field[k], field[k - 1]) for field in fields)
