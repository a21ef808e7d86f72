"""Frames of all joints in the world, and the motions that each joint causes."""

from __future__ import annotations

import math

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.copying import copy_matrix
from parallel_robot_model.mechanisms.mechanism import BASE, HINGE, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    Triple,
    crossed,
    in_world,
    plus,
    set_row,
    times,
    triple,
    turned,
)
from parallel_robot_model.mechanisms.workspace import Workspace


@inner
def place(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write rotation, origin and S at the positions `trial`."""
    parent, kind, fixed = mechanism.parent, mechanism.kind, mechanism.rotation
    rotation, origin, S = workspace.rotation, workspace.origin, workspace.S
    still = (0.0, 0.0, 0.0)
    for i in range(len(parent)):
        position = workspace.trial[i]
        j = parent[i]
        offset = in_world(rotation, origin, j, triple(mechanism.origin, i))
        if j == BASE:
            copy_matrix(fixed[i], rotation[i])
        else:
            _multiply(rotation[j], fixed[i], rotation[i])
        own_axis = triple(mechanism.axis, i)
        axis = turned(rotation, i, own_axis)
        if kind[i] == HINGE:
            _turn(rotation[i], own_axis, position)
            set_row(S, i, axis, crossed(offset, axis))
        else:
            offset = plus(offset, times(axis, position))
            set_row(S, i, still, axis)
        origin[i, 0], origin[i, 1], origin[i, 2] = offset


@inner
def _multiply(a: Array, b: Array, out: Array) -> None:
    """Product of two matrices of shape (3, 3)."""
    for i in range(3):
        for k in range(3):
            out[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@inner
def _turn(rotation: Array, axis: Triple, angle: float) -> None:
    """Multiply a rotation by that about an axis of its own frame (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis
    k = 1.0 - c
    a, b, d = x * y * k, x * z * k, y * z * k
    x_x, x_y, x_z = c + x * x * k, a - z * s, b + y * s
    y_x, y_y, y_z = a + z * s, c + y * y * k, d - x * s
    z_x, z_y, z_z = b - y * s, d + x * s, c + z * z * k
    for i in range(3):
        u, v, w = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        rotation[i, 0] = u * x_x + v * y_x + w * z_x
        rotation[i, 1] = u * x_y + v * y_y + w * z_y
        rotation[i, 2] = u * x_z + v * y_z + w * z_z
