"""Frames of all joints in the world, and the motions that each joint causes."""

from __future__ import annotations

import math

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import BASE, HINGE, NO_COORDINATE, Mechanism
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

NEXT = (1, 2, 0, 1)  # coordinate after each, and the one after that


@inner
def place(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write rotation, origin and S at the positions `trial`.

    What would be multiplied by ones and zeros is left out: frames of joints mostly have the
    directions of that before, or its origin, and an axis is mostly a coordinate axis.
    """
    parent, kind, along = mechanism.parent, mechanism.kind, workspace.layout.along
    parallel, concentric = workspace.layout.parallel, workspace.layout.concentric
    rotation, origin, S = workspace.rotation, workspace.origin, workspace.S
    still = (0.0, 0.0, 0.0)
    for i in range(len(parent)):
        position = workspace.trial[i]
        j = parent[i]
        if j != BASE and concentric[i]:
            offset = triple(origin, j)
        else:
            offset = in_world(rotation, origin, j, triple(mechanism.origin, i))
        if j == BASE:
            _copy(mechanism.rotation, i, rotation, i)
        elif parallel[i]:
            _copy(rotation, j, rotation, i)
        else:
            _multiply(rotation, j, mechanism.rotation, rotation, i)
        k = along[i]
        if k == NO_COORDINATE:
            axis = turned(rotation, i, triple(mechanism.axis, i))
        else:
            axis = (rotation[i, 0, k], rotation[i, 1, k], rotation[i, 2, k])
        if kind[i] != HINGE:
            offset = plus(offset, times(axis, position))
            set_row(S, i, still, axis)
        else:
            if k == NO_COORDINATE:
                _turn(rotation, i, triple(mechanism.axis, i), position)
            else:
                _turn_coordinates(rotation, i, k, position)
            set_row(S, i, axis, crossed(offset, axis))
        origin[i, 0], origin[i, 1], origin[i, 2] = offset


@inner
def _copy(a: Array, j: int, out: Array, i: int) -> None:
    """Copy matrix j of `a` to matrix i, shape (3, 3)."""
    for row in range(3):
        for k in range(3):
            out[i, row, k] = a[j, row, k]


@inner
def _multiply(a: Array, j: int, b: Array, out: Array, i: int) -> None:
    """Write the product of matrix j of `a` and matrix i of `b` to matrix i, shape (3, 3)."""
    for row in range(3):
        x, y, z = a[j, row, 0], a[j, row, 1], a[j, row, 2]
        for k in range(3):
            out[i, row, k] = x * b[i, 0, k] + y * b[i, 1, k] + z * b[i, 2, k]


@inner
def _turn(rotation: Array, i: int, axis: Triple, angle: float) -> None:
    """Multiply rotation i by that about an axis of its own frame (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis
    k = 1.0 - c
    a, b, d = x * y * k, x * z * k, y * z * k
    x_x, x_y, x_z = c + x * x * k, a - z * s, b + y * s
    y_x, y_y, y_z = a + z * s, c + y * y * k, d - x * s
    z_x, z_y, z_z = b - y * s, d + x * s, c + z * z * k
    for row in range(3):
        u, v, w = rotation[i, row, 0], rotation[i, row, 1], rotation[i, row, 2]
        rotation[i, row, 0] = u * x_x + v * y_x + w * z_x
        rotation[i, row, 1] = u * x_y + v * y_y + w * z_y
        rotation[i, row, 2] = u * x_z + v * y_z + w * z_z


@inner
def _turn_coordinates(rotation: Array, i: int, k: int, angle: float) -> None:
    """The same about coordinate axis k."""
    c, s = math.cos(angle), math.sin(angle)
    same = c + (1.0 - c)  # 1, but for rounding: the bits are those of any axis
    a, b = NEXT[k], NEXT[k + 1]
    for row in range(3):
        u, v = rotation[i, row, a], rotation[i, row, b]
        rotation[i, row, a] = u * c + v * s
        rotation[i, row, b] = v * c - u * s
        rotation[i, row, k] *= same
