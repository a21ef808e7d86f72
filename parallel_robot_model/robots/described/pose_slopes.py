"""Derivatives of the pose of a machine by its actuated joints and by the origins of all joints.

An origin that lies elsewhere is three slides before the joint that are driven: what closes the
loops then tells how all joints follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import KinematicsError
from parallel_robot_model.mechanisms.body_motions import BodyMotions, body_motions
from parallel_robot_model.mechanisms.faults import FOUND
from parallel_robot_model.mechanisms.mechanism import BASE, SLIDE, Index, Mechanism
from parallel_robot_model.robots.described.parameters import FAULTS

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
        By the n actuated joints, then by x, y, z of each origin on the link before, shape
        (K, m, n + 3 N).

    Raises:
        KinematicsError: the loops cannot be closed at a sample.
    """
    n, N = len(mechanism.actuated), len(mechanism.parent)
    out = np.zeros((len(position), pose.shape[1], n + 3 * N))
    if not len(mechanism.coordinate):
        out[:, range(n), range(n)] = 1.0
        return out
    machine = with_slides(mechanism)
    for first in range(0, len(position), SAMPLES):
        part = slice(first, first + SAMPLES)
        joints = np.zeros((len(position[part]), n + 3 * N))
        joints[:, :n] = position[part]
        moved = body_motions(machine, joints, 0.0 * joints, 0.0 * joints)
        lost = np.flatnonzero(moved.fault != FOUND)
        if lost.size:
            sample = first + lost[0]
            raise KinematicsError(f'{FAULTS[int(moved.fault[lost[0]])].text} (sample {sample})')
        out[part] = _rates(machine, moved, mechanism.coordinate, pose[part])
    return out


def with_slides(mechanism: Mechanism) -> Mechanism:
    """The machine with three driven slides before each joint; its pose is what is driven."""
    N = len(mechanism.parent)
    every = EACH * np.arange(N)
    own = every + EACH - 1

    def placed(joint: Index) -> Index:
        """Numbers of joints, BASE included."""
        return np.where(joint == BASE, BASE, EACH * joint + EACH - 1)

    def spread(values: Any, other: Any = 0.0) -> Any:
        """Values of the joints, and another one for the slides."""
        out = np.empty((EACH * N, *values.shape[1:]), values.dtype)
        out[:] = other
        out[own] = values
        return out

    parent = np.arange(EACH * N) - 1
    parent[every] = placed(mechanism.parent)
    origin = np.zeros((EACH * N, 3))
    origin[every] = mechanism.origin
    axis = spread(mechanism.axis)
    for c in range(3):
        axis[every + c] = np.eye(3)[c]
    slides = (every[:, np.newaxis] + np.arange(3)).ravel()
    return mechanism._replace(
        parent=parent,
        kind=spread(mechanism.kind, SLIDE),
        rotation=spread(mechanism.rotation, np.eye(3)),
        origin=origin,
        axis=axis,
        mass=spread(mechanism.mass),
        centre=spread(mechanism.centre),
        inertia=spread(mechanism.inertia),
        armature=spread(mechanism.armature),
        first=placed(mechanism.first),
        second=placed(mechanism.second),
        actuated=np.concatenate([placed(mechanism.actuated), slides]),
        passive=placed(mechanism.passive),
        home=spread(mechanism.home),
        tool=int(placed(np.array(mechanism.tool))),
        coordinate=mechanism.coordinate[:0],
    )


def _rates(machine: Mechanism, moved: BodyMotions, coordinate: Index, pose: Array) -> Array:
    """Rates of the pose by all that is driven, shape (K, m, n + 3 N)."""
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

    See :func:`parallel_robot_model.mechanisms.rotation.vector_rate`.
    """
    angle = np.linalg.norm(x, axis=-1, keepdims=True)
    half = 0.5 * np.where(angle > SMALL, angle, 1.0)
    share = np.where(angle > SMALL, (1.0 - half / np.tan(half)) / (4.0 * half**2), 1.0 / 12.0)
    once = np.cross(x, angular)
    return np.asarray(angular - 0.5 * once + share * np.cross(x, once))
