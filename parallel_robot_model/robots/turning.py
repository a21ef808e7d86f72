"""By how much an end effector in space is turned from where it should be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import Coordinate

PLACE = ('x', 'y', 'z')
VECTOR = ('rx', 'ry', 'rz')  # components of a rotation vector in the world


def turns_of(coordinates: Sequence[Coordinate]) -> tuple[int, ...]:
    """Components of the rotation vector, 0 to 2, that follow the place in a pose in space."""
    names = tuple(axis.name for axis in coordinates)
    if names[:3] != PLACE or not {*names[3:]} <= {*VECTOR}:
        return ()
    return tuple(VECTOR.index(name) for name in names[3:])


def angles_between(actual: Array, reference: Array, turns: Sequence[int]) -> Array:
    """Angles of the rotations from some poses to others [rad], shape (N,).

    Args:
        actual: Poses in space, shape (N, m).
        reference: Other ones, shape (N, m).
        turns: See :func:`turns_of`; NaN if there are none.
    """
    if not turns:
        return np.full(len(actual), np.nan)
    (u, p), (v, q) = (_quaternions(poses, turns) for poses in (actual, reference))
    apart = p * v - q * u - np.cross(u, v)
    alike = np.abs(p * q + np.sum(u * v, axis=1, keepdims=True))[:, 0]
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(apart, axis=1), alike))


def _quaternions(poses: Array, turns: Sequence[int]) -> tuple[Array, Array]:
    """Vectors, shape (N, 3), and scalars, shape (N, 1), of the rotations of poses."""
    vectors = np.zeros((len(poses), 3))
    vectors[:, list(turns)] = poses[:, len(PLACE) :]
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return 0.5 * np.sinc(half / np.pi) * vectors, np.cos(half)
