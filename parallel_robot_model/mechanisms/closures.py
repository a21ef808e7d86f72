"""How far the loops are open, and how that changes with the joints."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import BASE, COUPLING, POINT, Index, Mechanism
from parallel_robot_model.mechanisms.placing import place
from parallel_robot_model.mechanisms.spatial import (
    Triple,
    clear_matrix,
    copy_matrix,
    crossed,
    in_world,
    inner_product,
    minus,
    second_triple,
    times,
    triple,
    velocity,
)
from parallel_robot_model.mechanisms.workspace import Workspace, factor


@inner
def settle(mechanism: Mechanism, workspace: Workspace) -> int:
    """Place the joints at `trial`, and write errors, Jacobian, and its factors.

    Returns:
        Sign of the determinant of the passive block; 0 where it is singular.
    """
    place(mechanism, workspace)
    if len(workspace.error) == 0:
        return 1
    errors(mechanism, workspace)
    jacobian(mechanism, workspace)
    copy_matrix(workspace.jacobian, workspace.factors.a)
    return factor(workspace.factors)


@inner
def errors(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write the errors of all closures at the present frames."""
    group, normal, error = workspace.layout.group, workspace.layout.normal, workspace.error
    for g in range(len(group) - 1):
        k = group[g]
        if mechanism.closure[k] == COUPLING:
            error[k] = _coupling_error(mechanism, workspace, k)
            continue
        if mechanism.closure[k] == POINT:
            open_by = minus(*points(mechanism, workspace, k))
        else:
            open_by = _turned_by(mechanism, workspace, k)
        for row in range(k, group[g + 1]):
            error[row] = inner_product(triple(normal, row), open_by)


@inner
def _coupling_error(mechanism: Mechanism, workspace: Workspace, k: int) -> float:
    """Position of joint a - offset - ratio * position of joint b."""
    first, second = mechanism.first[k], mechanism.second[k]
    error = -mechanism.offset[k]
    if first != BASE:
        error += workspace.trial[first]
    if second != BASE:
        error -= mechanism.ratio[k] * workspace.trial[second]
    return error * workspace.layout.unit[k]


@inner
def points(mechanism: Mechanism, workspace: Workspace, k: int) -> tuple[Triple, Triple]:
    """Both points of a closure in the world."""
    rotation, origin = workspace.rotation, workspace.origin
    return (
        in_world(rotation, origin, mechanism.first[k], triple(mechanism.first_point, k)),
        in_world(rotation, origin, mechanism.second[k], triple(mechanism.second_point, k)),
    )


@inner
def _turned_by(mechanism: Mechanism, workspace: Workspace, k: int) -> Triple:
    """Sine of the angle times the axis of the rotation from joint b to joint a.

    It is that of E = R_a turned R_b^T, whose rows and columns are summed without E.
    """
    first, second, turned = mechanism.first[k], mechanism.second[k], mechanism.turned[k]
    x, y, z = 0.0, 0.0, 0.0
    for c in range(3):  # E = sum of outer products of columns; 2 sin * axis = sum of b x a
        a = (turned[0, c], turned[1, c], turned[2, c])
        b = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
        if first != BASE:
            R = workspace.rotation[first]
            a = (
                R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
                R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
                R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
            )
        if second != BASE:
            R = workspace.rotation[second]
            b = (R[0, c], R[1, c], R[2, c])
        part = crossed(b, a)
        x, y, z = x + part[0], y + part[1], z + part[2]
    return 0.5 * x, 0.5 * y, 0.5 * z


@inner
def jacobian(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write the derivatives of the errors by passive and actuated joints."""
    layout, S, out = workspace.layout, workspace.S, workspace.jacobian
    group, parent, normal, column = layout.group, mechanism.parent, layout.normal, layout.column
    clear_matrix(out)
    for g in range(len(group) - 1):
        k = group[g]
        first, second = mechanism.first[k], mechanism.second[k]
        if mechanism.closure[k] == COUPLING:
            _add(out, k, column, first, layout.unit[k] * _unit(layout.scale, first))
            part = -layout.unit[k] * mechanism.ratio[k] * _unit(layout.scale, second)
            _add(out, k, column, second, part)
            continue
        point, other = points(mechanism, workspace, k)
        for side in range(2):
            i = first if side == 0 else second
            x = point if side == 0 else other
            while i != BASE:
                c = column[i]
                if c >= 0:
                    by = layout.scale[i] if side == 0 else -layout.scale[i]
                    motion = triple(S, i)
                    if mechanism.closure[k] == POINT:
                        motion = velocity(motion, second_triple(S, i), x)
                    motion = times(motion, by)
                    for row in range(k, group[g + 1]):
                        out[row, c] += inner_product(triple(normal, row), motion)
                i = parent[i]


@inner
def _unit(scale: Array, joint: int) -> float:
    return scale[joint] if joint != BASE else 0.0


@inner
def _add(out: Array, k: int, column: Index, joint: int, part: float) -> None:
    if joint != BASE and column[joint] >= 0:
        out[k, column[joint]] += part
