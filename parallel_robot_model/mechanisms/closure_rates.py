"""Rates of the passive joints by those of the actuated ones, and their derivatives."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.closures import points
from parallel_robot_model.mechanisms.mechanism import BASE, COUPLING, POINT, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    Triple,
    clear,
    clear_matrix,
    crossed,
    inner_product,
    minus,
    plus,
    second_triple,
    triple,
    velocity,
)
from parallel_robot_model.mechanisms.workspace import Workspace, solve_columns, solve_vector


@inner
def derive(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write W, the rates of all joints by those of the actuated ones."""
    right, jacobian, r = workspace.right, workspace.jacobian, len(workspace.error)
    if r == 0:
        return
    for k in range(r):
        for j in range(len(mechanism.actuated)):
            right[k, j] = -jacobian[k, r + j]
    solve_columns(workspace.factors, right)
    _units(mechanism, workspace)
    _spread(workspace, workspace.W)


@inner
def _units(mechanism: Mechanism, workspace: Workspace) -> None:
    """Take the units of the actuated joints out of the solution."""
    for j in range(len(mechanism.actuated)):
        unit = 1.0 / workspace.layout.scale[mechanism.actuated[j]]
        if unit != 1.0:
            for k in range(len(workspace.right)):
                workspace.right[k, j] *= unit


@inner
def _spread(workspace: Workspace, out: Array) -> None:
    """Write solutions to the rows of the passive joints."""
    passive, right = workspace.layout.passive, workspace.right
    for c in range(len(passive)):
        unit = workspace.layout.scale[passive[c]]
        for j in range(out.shape[1]):
            out[passive[c], j] = unit * right[c, j]


@inner
def derive_rate(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write the derivative of W; the motions of the bodies are known."""
    layout, S, S_rate, W = workspace.layout, workspace.S, workspace.S_rate, workspace.W
    right, group, parent = workspace.right, layout.group, mechanism.parent
    if len(right) == 0:
        return
    clear_matrix(right)
    for g in range(len(group) - 1):
        k = group[g]
        if mechanism.closure[k] == COUPLING:
            continue
        point, other = points(mechanism, workspace, k)
        for side in range(2):
            i = mechanism.first[k] if side == 0 else mechanism.second[k]
            x = point if side == 0 else other
            if i == BASE:
                continue
            x_rate = velocity(triple(workspace.V, i), second_triple(workspace.V, i), x)
            while i != BASE:
                if layout.column[i] >= 0:
                    motion = triple(S_rate, i)
                    if mechanism.closure[k] == POINT:
                        motion = velocity(motion, second_triple(S_rate, i), x)
                        motion = plus(motion, crossed(triple(S, i), x_rate))
                    for row in range(k, group[g + 1]):
                        part = inner_product(triple(layout.normal, row), motion)
                        if side == 0:
                            part = -part
                        for j in range(len(mechanism.actuated)):
                            right[row, j] += part * W[i, j]
                i = parent[i]
    solve_columns(workspace.factors, right)
    _spread(workspace, workspace.W_rate)


@inner
def bias(mechanism: Mechanism, workspace: Workspace, out: Array) -> None:
    """Write the accelerations of all joints at no acceleration of the actuated ones.

    `A` holds the accelerations of the bodies at none of any joint.
    """
    layout, single, group = workspace.layout, workspace.single, workspace.layout.group
    clear(out)
    if len(single) == 0:
        return
    for g in range(len(group) - 1):
        k = group[g]
        if mechanism.closure[k] == COUPLING:
            single[k] = 0.0
            continue
        point, other = points(mechanism, workspace, k)
        is_point = mechanism.closure[k] == POINT
        apart = minus(
            _acceleration(workspace, mechanism.second[k], other, is_point),
            _acceleration(workspace, mechanism.first[k], point, is_point),
        )
        for row in range(k, group[g + 1]):
            single[row] = inner_product(triple(layout.normal, row), apart)
    solve_vector(workspace.factors, single)
    for c in range(len(layout.passive)):
        out[layout.passive[c]] = layout.scale[layout.passive[c]] * single[c]


@inner
def _acceleration(workspace: Workspace, i: int, x: Triple, is_point: bool) -> Triple:
    """Acceleration of a point of body i, or of its rotation."""
    if i == BASE:
        return 0.0, 0.0, 0.0
    V, A = workspace.V, workspace.A
    angular = triple(A, i)
    if not is_point:
        return angular
    turning = triple(V, i)
    own = velocity(angular, second_triple(A, i), x)
    return plus(own, crossed(turning, velocity(turning, second_triple(V, i), x)))
