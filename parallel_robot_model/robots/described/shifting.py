"""A machine whose joints and loops lie elsewhere than its file says; they are closed anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import KinematicsError, RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.dynamics import BodyMotions, body_motions
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, POINT, Index, Mechanism
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.described.parameters import FAULTS

SHORTEST = 2.0**-6  # of the shift, that is closed at once


def loops(mechanism: Mechanism) -> list[Index]:
    """Rows of the closures that hold two points together, an array for each such pair."""
    rows: dict[tuple[float, ...], list[int]] = {}
    m = mechanism
    for k in np.flatnonzero(m.closure == POINT):
        pair = (m.first[k], m.second[k], *m.first_point[k], *m.second_point[k])
        rows.setdefault(pair, []).append(int(k))
    return [np.array(each) for each in rows.values()]


def shifted(mechanism: Mechanism, shift: Sequence[float]) -> Mechanism:
    """The machine with other origins of its joints, and other points where its loops close.

    The actuated joints of home stay, the passive ones follow. Closures that are redundant in the
    file stay out of account.

    Args:
        mechanism: The machine.
        shift: By which each joint lies elsewhere, on the link before [m], 3 numbers a joint; then
            the two points of each of its :func:`loops`, on their links, 6 numbers a loop.

    Raises:
        RobotError: its loops do not close.
    """
    if not any(shift):
        return mechanism
    whole, home, done, step = np.reshape(shift, (-1, 3)), mechanism.home, 0.0, 1.0
    origins, (firsts, seconds) = _parts(mechanism, whole)
    while done < 1.0:
        part = done + step
        moved = mechanism._replace(
            origin=mechanism.origin + part * origins,
            first_point=mechanism.first_point + part * firsts,
            second_point=mechanism.second_point + part * seconds,
            home=home,
        )
        value, made = boxed(moved)
        if close(value, made, made.q.copy()) == FOUND:
            home, done = made.all.copy(), done + step
            continue
        step *= 0.5
        if step < SHORTEST:
            raise RobotError('shift: the loops of the machine cannot be closed near home')
    return moved._replace(home=home)


def _parts(mechanism: Mechanism, shift: Array) -> tuple[Array, Array]:
    """What of it is of the joints, shape (N, 3), and of the closures, shape (2, r, 3)."""
    N = len(mechanism.parent)
    points = np.zeros((2, *mechanism.first_point.shape))
    for number, rows in enumerate(loops(mechanism)):
        for end in range(2):
            points[end, rows] = shift[N + 2 * number + end]
    return shift[:N], points


# Derivatives of the pose of a machine by its actuated joints and by where joints and loops lie.
#
# An origin that lies elsewhere is three slides before the joint that are driven, a point of a loop
# three slides that carry it: what closes the loops then tells how all joints follow.

SAMPLES = 500  # at once, which bounds the memory
EACH = 4  # joints in place of one: three slides, and itself
SMALL = 1e-4  # rad, below which a series is exact


def pose_slopes(mechanism: Mechanism, position: Array, pose: Array) -> Array:
    """Derivatives of the pose at many postures.

    Args:
        mechanism: The machine.
        position: Its actuated joints [rad or m], shape (K, n).
        pose: The poses there, shape (K, m).

    Returns:
        By the n actuated joints, then by x, y, z of each origin on the link before, then of the
        two points of each of L loops on their links, shape (K, m, n + 3 N + 6 L).

    Raises:
        KinematicsError: the loops cannot be closed at a sample.
    """
    n, machine = len(mechanism.actuated), with_slides(mechanism)
    count = len(machine.actuated)
    out = np.zeros((len(position), pose.shape[1], count))
    if not len(mechanism.coordinate):
        out[:, range(n), range(n)] = 1.0
        return out
    for first in range(0, len(position), SAMPLES):
        part = slice(first, first + SAMPLES)
        joints = np.zeros((len(position[part]), count))
        joints[:, :n] = position[part]
        moved = body_motions(machine, joints, 0.0 * joints, 0.0 * joints)
        lost = np.flatnonzero(moved.fault != FOUND)
        if lost.size:
            sample = first + lost[0]
            raise KinematicsError(f'{FAULTS[int(moved.fault[lost[0]])].text} (sample {sample})')
        out[part] = _rates(machine, moved, mechanism.coordinate, pose[part])
    return out


def with_slides(mechanism: Mechanism) -> Mechanism:
    """The machine with three driven slides before each joint and point of a loop.

    Its pose is what is driven.
    """
    N, pairs = len(mechanism.parent), loops(mechanism)
    count = EACH * N + 6 * len(pairs)
    every = EACH * np.arange(N)
    own = every + EACH - 1

    def placed(joint: Index) -> Index:
        """Numbers of joints, BASE included."""
        return np.where(joint == BASE, BASE, EACH * joint + EACH - 1)

    def spread(values: Any, other: Any = 0.0) -> Any:
        """Values of the joints, and another one for the slides."""
        out = np.empty((count, *values.shape[1:]), values.dtype)
        out[:] = other
        out[own] = values
        return out

    parent = np.arange(count) - 1
    parent[every] = placed(mechanism.parent)
    origin = np.zeros((count, 3))
    origin[every] = mechanism.origin
    axis = spread(mechanism.axis)
    begins = np.concatenate([every, np.arange(EACH * N, count, 3)])  # of three slides
    for c in range(3):
        axis[begins + c] = np.eye(3)[c]
    slides = (begins[:, np.newaxis] + np.arange(3)).ravel()
    ends = placed(mechanism.first), placed(mechanism.second)
    points = mechanism.first_point.copy(), mechanism.second_point.copy()
    begin = EACH * N
    for rows in pairs:
        for end, point in zip(ends, points, strict=True):
            parent[begin], origin[begin] = end[rows[0]], point[rows[0]]
            end[rows], point[rows] = begin + 2, 0.0
            begin += 3
    return mechanism._replace(
        parent=parent,
        turns=spread(mechanism.turns),
        slides=spread(mechanism.slides, 1.0),
        rotation=spread(mechanism.rotation, np.eye(3)),
        origin=origin,
        axis=axis,
        mass=spread(mechanism.mass),
        centre=spread(mechanism.centre),
        inertia=spread(mechanism.inertia),
        armature=spread(mechanism.armature),
        first=ends[0],
        second=ends[1],
        first_point=points[0],
        second_point=points[1],
        actuated=np.concatenate([placed(mechanism.actuated), slides]),
        passive=placed(mechanism.passive),
        home=spread(mechanism.home),
        tool=int(placed(np.array(mechanism.tool))),
        coordinate=mechanism.coordinate[:0],
    )


def _rates(machine: Mechanism, moved: BodyMotions, coordinate: Index, pose: Array) -> Array:
    """Rates of the pose by all that is driven, shape (K, m, n + 3 N + 6 L)."""
    motion = np.zeros((*moved.W[:, 0].shape, 6))  # of the tool
    joint = machine.tool
    while joint != BASE:
        motion += moved.W[:, joint, :, None] * moved.S[:, joint, None]
        joint = int(machine.parent[joint])
    rotation, origin = moved.rotation[:, machine.tool], moved.origin[:, machine.tool]
    point = origin + rotation @ machine.tool_point
    linear = motion[..., 3:] + np.cross(motion[..., :3], point[:, np.newaxis])
    vector = np.zeros((len(pose), 3))
    turns = coordinate >= len('xyz')
    vector[:, coordinate[turns] - len('xyz')] = pose[:, turns]
    rates = np.concatenate([linear, _vector_rate(vector[:, np.newaxis], motion[..., :3])], axis=2)
    return np.asarray(rates[..., coordinate].swapaxes(1, 2))


def _vector_rate(x: Array, angular: Array) -> Array:
    """Rate of a rotation vector at angular velocities, shapes (K, 1, 3) and (K, L, 3).

    See :func:`parallel_robot_model.mechanisms.spatial.vector_rate`.
    """
    angle = np.linalg.norm(x, axis=-1, keepdims=True)
    half = 0.5 * np.where(angle > SMALL, angle, 1.0)
    share = np.where(angle > SMALL, (1.0 - half / np.tan(half)) / (4.0 * half**2), 1.0 / 12.0)
    once = np.cross(x, angular)
    return np.asarray(angular - 0.5 * once + share * np.cross(x, once))
