"""A mechanism as a value: arrays for a tree of hinges and slides and for what closes its loops.

One compiled set of kernels serves all mechanisms, whatever their number of joints. A joint has a
frame that moves with its body and whose origin lies on its axis. A ball is three hinges, a
universal joint two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array

# What a kernel returns: that it has found something, or why not.

FOUND = 0  # no fault
NOT_CLOSED = 1  # no posture fits: out of reach
SINGULAR = 2  # the closures, or those and the tool, lose their rank on the way
NOT_FINITE = 3  # a position is not a number


Index = NDArray[np.int64]

POINT, ORIENTATION, COUPLING = 0, 1, 2  # kinds of closures
WHOLE, LAST, FIRST = 0, 1, 2  # parts of the rotor of a ball
BASE = -1  # in place of a joint: what does not move


class Elements(NamedTuple):
    """What acts in a mechanism of N joints along T lengths, see `mechanisms.passive`."""

    lifted: Array  # mass whose weight is taken off each body [kg], shape (N,)
    lifted_at: Array  # its centre in the frame of the joint [m], shape (N, 3)
    # rotor of the ball whose last hinge a joint is: that felt at the relative rate of its bodies,
    # across its last hinge and across its first one [kg m^2], shape (N, 3)
    ball: Array
    ratio: Array  # share of each joint in the lengths, shape (T, N)
    rest: Array  # lengths between which the spring is slack [rad or m], shape (T, 2)
    stiffness: Array  # coefficients of the spring [N m/rad or N/m, ...], shape (T, 3)
    damping: Array  # coefficients of the damper [N m s/rad or N s/m, ...], shape (T, 3)
    armature: Array  # inertia that the rate of the length meets [kg m^2 or kg], shape (T,)
    travel: Array  # ends of the length [rad or m], infinite where there is none, shape (T, 2)


def elements(joints: int, lengths: int = 0) -> Elements:
    """Elements that do nothing, of a mechanism of N joints along T lengths."""
    N, T = joints, lengths
    shapes = (N,), (N, 3), (N, 3), (T, N), (T, 2), (T, 3), (T, 3), (T,), (T, 2)
    found = Elements(*map(np.zeros, shapes))
    found.travel[:] = -np.inf, np.inf
    return found


class Mechanism(NamedTuple):
    """A mechanism of N joints, r closures, n actuated joints and m coordinates of its tool.

    As many closures as passive joints, independent of each other at home. The joint `parent[i]`
    comes before joint i.
    """

    parent: Index  # the joint before on the chain, or BASE, shape (N,)
    # rad that a joint turns about its axis by unit of its position; 0: that is a length, shape
    # (N,)
    turns: Array
    slides: Array  # m that it slides along its axis likewise, shape (N,)
    # frame of the joint at position zero, seen from that of its parent, shape (N, 3, 3)
    rotation: Array
    origin: Array  # its origin in the frame of the parent [m], shape (N, 3)
    axis: Array  # its axis in its own frame, a unit vector, shape (N, 3)
    mass: Array  # mass of its body [kg], shape (N,)
    centre: Array  # centre of mass in its frame [m], shape (N, 3)
    inertia: Array  # about the centre of mass in its frame [kg m^2], shape (N, 3, 3)
    armature: Array  # inertia of its rotor, as felt at the joint [kg m^2 or kg], shape (N,)
    gravity: Array  # acceleration of gravity in the world [m/s^2], shape (3,)
    elements: Elements  # springs, dampers, rotors and lifts beside these
    # kind of each closure, shape (r,). POINT: a component of the distance between a point on
    # joint a and one on joint b is zero; ORIENTATION: a component of the rotation from one to the
    # other is; COUPLING: position of joint a = offset + ratio * position of b
    closure: Index
    first: Index  # joint a of the closure, or BASE, shape (r,)
    second: Index  # joint b of the closure, or BASE, shape (r,)
    first_point: Array  # the point in the frame of joint a [m], shape (r, 3); POINT alone
    second_point: Array  # that in the frame of joint b [m], shape (r, 3); POINT alone
    # rotation of b seen from a where the closure is met, shape (r, 3, 3); ORIENTATION alone
    relative_rotation: Array
    direction: Array  # which component, a unit vector of the world, shape (r, 3)
    ratio: Array  # of a COUPLING, shape (r,)
    offset: Array  # of a COUPLING [rad or m], shape (r,)
    actuated: Index  # the n actuated joints, shape (n,)
    passive: Index  # the r joints that follow by the closures, shape (r,)
    # positions of all joints in a closed posture [rad or m], shape (N,); joints that are
    # neither actuated nor passive are held there
    home: Array
    tool: int  # the joint that carries the tool, or BASE
    tool_point: Array  # the tool in the frame of that joint [m], shape (3,)
    tool_rotation: Array  # frame of the tool seen from that of the joint, shape (3, 3)
    tool_home: Array  # frame of the tool in the world at home, shape (3, 3)
    # coordinates of the pose, shape (m,): 0 to 2 are x, y, z of the tool [m], 3 to 5 the
    # components of its rotation vector from `tool_home` in the world [rad]; empty: the pose
    # is the actuated joints
    coordinate: Index
    length: float  # a length of the machine, by which angles and lengths are compared [m]


# What follows from a mechanism once and for all: columns, units, groups of closures.

NO_COORDINATE = -1  # in place of a coordinate: an axis along none
LOCKED = -1  # in place of a column: a joint that is neither actuated nor passive
GRID = 2.0**-24  # rad; of slides: times the power of two nearest to the length


class Layout(NamedTuple):
    """Tables of a mechanism of N joints, r closures and n actuated joints."""

    # column of each joint among the passive ones, from 0, or the actuated ones, from r, or
    # LOCKED, shape (N,)
    column: Index
    # passive joints in the order of their columns, those with few closures first, so that
    # elimination fills little, shape (r,)
    passive: Index
    moving: Index  # joints that are not held, in their order, shape (n + r,)
    scale: Array  # unit of a joint: the length for slides, 1 for hinges, shape (N,)
    grid: Array  # what positions are rounded to, shape (N,)
    group: Index  # first closure of each group that shares its points, then r, shape (groups + 1,)
    normal: Array  # direction of each closure in units that make its error a number, shape (r, 3)
    unit: Array  # what makes the error of a coupling a number, shape (r,)
    # which coordinate axis of its frame a joint has as its axis, 0 to 2, or NO_COORDINATE,
    # shape (N,)
    along: Index
    # whether its frame has the directions of that before at position zero, shape (N,)
    parallel: Index
    concentric: Index  # whether its frame has the origin of that before, shape (N,)
    carries: Index  # whether a joint moves the tool, shape (N,)
    rotations: int  # number of rotation coordinates of the pose
    rotation_coordinate: int  # the only one, 3 to 5, or 0


def layout(mechanism: Mechanism) -> Layout:
    """Tables of a mechanism."""
    m = mechanism
    slides = m.turns == 0.0
    scale = np.where(slides, m.length, 1.0)
    passive = m.passive[np.argsort(_closures_on(m)[m.passive], kind='stable')]
    column = np.full(len(m.parent), LOCKED)
    column[passive] = np.arange(len(passive))
    column[m.actuated] = len(passive) + np.arange(len(m.actuated))
    first_slides = (m.first != BASE) & slides[m.first]
    lengths = (m.closure == POINT) | ((m.closure == COUPLING) & first_slides)
    unit = np.where(lengths, 1.0 / m.length, 1.0)
    rotations = m.coordinate[m.coordinate >= 3]
    return Layout(
        column,
        passive,
        np.flatnonzero(column != LOCKED),
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
    fields = (m.closure, m.first, m.second, m.first_point, m.second_point, m.relative_rotation)
    return all(np.array_equal(field[k], field[k - 1]) for field in fields)
