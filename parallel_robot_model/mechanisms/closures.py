"""How far the loops are open, and how that changes with the joints."""

from __future__ import annotations

import math

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cross, dot, internal, kernel, vector
from parallel_robot_model.mechanisms.mechanism import (
    BASE,
    COUPLING,
    NO_COORDINATE,
    POINT,
    Index,
    Mechanism,
)
from parallel_robot_model.mechanisms.spatial import (
    clear,
    clear_matrix,
    column,
    copy_matrix,
    in_world,
    matrix,
    nothing,
    put,
    triple,
    velocity,
)
from parallel_robot_model.mechanisms.workspace import (
    Workspace,
    factor,
    solve_columns,
    solve_vector,
)

# Frames of all joints in the world, and the motions that each joint causes.

NEXT = (1, 2, 0, 1)  # coordinate after each, and the one after that


@internal
def update_frames(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write rotation, origin and S at the positions `trial`.

    What would be multiplied by ones and zeros is left out: frames of joints mostly have the
    directions of that before, or its origin, and an axis is mostly a coordinate axis.
    """
    parent, along = mechanism.parent, workspace.layout.along
    turns, slides = mechanism.turns, mechanism.slides
    parallel, concentric = workspace.layout.parallel, workspace.layout.concentric
    rotation, origin, S = workspace.rotation, workspace.origin, workspace.S
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
            axis = matrix(rotation[i]) @ triple(mechanism.axis, i)
        else:
            axis = column(rotation[i], k)
        if slides[i] != 0.0:
            offset = offset + slides[i] * position * axis
            put(S, i, 0, nothing())
            put(S, i, 3, slides[i] * axis)
        if turns[i] != 0.0:
            if k == NO_COORDINATE:
                _rotate(rotation, i, triple(mechanism.axis, i), turns[i] * position)
            else:
                _rotate_about_coordinate(rotation, i, k, turns[i] * position)
            put(S, i, 0, turns[i] * axis)
            put(S, i, 3, turns[i] * cross(offset, axis) + slides[i] * axis)
        put(origin, i, 0, offset)


@internal
def _copy(a: Array, j: int, out: Array, i: int) -> None:
    """Copy matrix j of `a` to matrix i, shape (3, 3)."""
    for row in range(3):
        for k in range(3):
            out[i, row, k] = a[j, row, k]


@internal
def _multiply(a: Array, j: int, b: Array, out: Array, i: int) -> None:
    """Write the product of matrix j of `a` and matrix i of `b` to matrix i, shape (3, 3)."""
    for row in range(3):
        x, y, z = a[j, row, 0], a[j, row, 1], a[j, row, 2]
        for k in range(3):
            out[i, row, k] = x * b[i, 0, k] + y * b[i, 1, k] + z * b[i, 2, k]


@internal
def _rotate(rotation: Array, i: int, axis: Array, angle: float) -> None:
    """Multiply rotation i by that about an axis of its own frame (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
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


@internal
def _rotate_about_coordinate(rotation: Array, i: int, k: int, angle: float) -> None:
    """The same about coordinate axis k."""
    c, s = math.cos(angle), math.sin(angle)
    same = c + (1.0 - c)  # 1, but for rounding: the bits are those of any axis
    a, b = NEXT[k], NEXT[k + 1]
    for row in range(3):
        u, v = rotation[i, row, a], rotation[i, row, b]
        rotation[i, row, a] = u * c + v * s
        rotation[i, row, b] = v * c - u * s
        rotation[i, row, k] *= same


@internal
def evaluate(mechanism: Mechanism, workspace: Workspace) -> int:
    """Place the joints at `trial`, and write errors, Jacobian, and its factors.

    Returns:
        Sign of the determinant of the passive block; 0 where it is singular.
    """
    update_frames(mechanism, workspace)
    if len(workspace.error) == 0:
        return 1
    errors(mechanism, workspace)
    jacobian(mechanism, workspace)
    copy_matrix(workspace.jacobian, workspace.factors.a)
    return factor(workspace.factors)


@internal
def errors(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write the errors of all closures at the present frames."""
    group, normal, error = workspace.layout.group, workspace.layout.normal, workspace.error
    for g in range(len(group) - 1):
        k = group[g]
        if mechanism.closure[k] == COUPLING:
            error[k] = _coupling_error(mechanism, workspace, k)
            continue
        if mechanism.closure[k] == POINT:
            point, other = points(mechanism, workspace, k)
            open_by = point - other
        else:
            open_by = _rotation_error(mechanism, workspace, k)
        for row in range(k, group[g + 1]):
            error[row] = dot(triple(normal, row), open_by)


@internal
def _coupling_error(mechanism: Mechanism, workspace: Workspace, k: int) -> float:
    """Position of joint a - offset - ratio * position of joint b."""
    first, second = mechanism.first[k], mechanism.second[k]
    error = -mechanism.offset[k]
    if first != BASE:
        error += workspace.trial[first]
    if second != BASE:
        error -= mechanism.ratio[k] * workspace.trial[second]
    return error * workspace.layout.unit[k]


@internal
def points(mechanism: Mechanism, workspace: Workspace, k: int) -> tuple[Array, Array]:
    """Both points of a closure in the world."""
    rotation, origin = workspace.rotation, workspace.origin
    return (
        in_world(rotation, origin, mechanism.first[k], triple(mechanism.first_point, k)),
        in_world(rotation, origin, mechanism.second[k], triple(mechanism.second_point, k)),
    )


@internal
def _rotation_error(mechanism: Mechanism, workspace: Workspace, k: int) -> Array:
    """Sine of the angle times the axis of the rotation from joint b to joint a.

    It is that of E = R_a R R_b^T, R the relative rotation, whose rows and columns are summed
    without E.
    """
    first, second, turned = mechanism.first[k], mechanism.second[k], mechanism.relative_rotation[k]
    total = nothing()
    for c in range(3):  # E = sum of outer products of columns; 2 sin * axis = sum of b x a
        a = column(turned, c)
        b = vector((1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0))
        if first != BASE:
            a = matrix(workspace.rotation[first]) @ a
        if second != BASE:
            b = column(workspace.rotation[second], c)
        total = total + cross(b, a)
    return 0.5 * total


@internal
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
                        motion = velocity(motion, triple(S, i, 3), x)
                    motion = by * motion
                    for row in range(k, group[g + 1]):
                        out[row, c] += dot(triple(normal, row), motion)
                i = parent[i]


@internal
def _unit(scale: Array, joint: int) -> float:
    return scale[joint] if joint != BASE else 0.0


@internal
def _add(out: Array, k: int, column: Index, joint: int, part: float) -> None:
    if joint != BASE and column[joint] >= 0:
        out[k, column[joint]] += part


# Rates of the passive joints by those of the actuated ones, and their derivatives.


@internal
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
    _scatter(workspace, workspace.W)


@internal
def _units(mechanism: Mechanism, workspace: Workspace) -> None:
    """Take the units of the actuated joints out of the solution."""
    for j in range(len(mechanism.actuated)):
        unit = 1.0 / workspace.layout.scale[mechanism.actuated[j]]
        if unit != 1.0:
            for k in range(len(workspace.right)):
                workspace.right[k, j] *= unit


@internal
def _scatter(workspace: Workspace, out: Array) -> None:
    """Write solutions to the rows of the passive joints."""
    passive, right = workspace.layout.passive, workspace.right
    for c in range(len(passive)):
        unit = workspace.layout.scale[passive[c]]
        for j in range(out.shape[1]):
            out[passive[c], j] = unit * right[c, j]


@internal
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
            x_rate = velocity(triple(workspace.V, i), triple(workspace.V, i, 3), x)
            while i != BASE:
                if layout.column[i] >= 0:
                    motion = triple(S_rate, i)
                    if mechanism.closure[k] == POINT:
                        motion = velocity(motion, triple(S_rate, i, 3), x)
                        motion = motion + cross(triple(S, i), x_rate)
                    for row in range(k, group[g + 1]):
                        part = dot(triple(layout.normal, row), motion)
                        if side == 0:
                            part = -part
                        for j in range(len(mechanism.actuated)):
                            right[row, j] += part * W[i, j]
                i = parent[i]
    solve_columns(workspace.factors, right)
    _scatter(workspace, workspace.W_rate)


@internal
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
        apart = _acceleration(workspace, mechanism.second[k], other, is_point)
        apart = apart - _acceleration(workspace, mechanism.first[k], point, is_point)
        for row in range(k, group[g + 1]):
            single[row] = dot(triple(layout.normal, row), apart)
    solve_vector(workspace.factors, single)
    for c in range(len(layout.passive)):
        out[layout.passive[c]] = layout.scale[layout.passive[c]] * single[c]


@internal
def _acceleration(workspace: Workspace, i: int, x: Array, is_point: bool) -> Array:
    """Acceleration of a point of body i, or of its rotation."""
    if i == BASE:
        return nothing()
    V, A = workspace.V, workspace.A
    angular = triple(A, i)
    if not is_point:
        return angular
    turning = triple(V, i)
    own = velocity(angular, triple(A, i, 3), x)
    return own + cross(turning, velocity(turning, triple(V, i, 3), x))


# Motions of the joints and bodies at rates of the actuated joints.


@kernel
def joint_rates(mechanism: Mechanism, workspace: Workspace, velocity: Array) -> None:
    """Write `rate`, the rates of all joints, at those of the actuated ones, shape (n,)."""
    W, rate = workspace.W, workspace.rate
    for i in range(len(rate)):
        total = 0.0
        for j in range(len(velocity)):
            total += W[i, j] * velocity[j]
        rate[i] = total


@internal
def motions(mechanism: Mechanism, workspace: Workspace, rate: Array) -> None:
    """Write V and S_rate at the rates of all joints, shape (N,)."""
    parent, S, V, S_rate = mechanism.parent, workspace.S, workspace.V, workspace.S_rate
    for i in range(len(parent)):
        j = parent[i]
        turn, slide = triple(S, i), triple(S, i, 3)
        angular, linear = rate[i] * turn, rate[i] * slide
        if j != BASE:
            angular, linear = triple(V, j) + angular, triple(V, j, 3) + linear
        put(V, i, 0, angular)
        put(V, i, 3, linear)
        put(S_rate, i, 0, cross(angular, turn))
        put(S_rate, i, 3, cross(linear, turn) + cross(angular, slide))


@internal
def accelerations(
    mechanism: Mechanism, workspace: Workspace, rate: Array, acceleration: Array
) -> None:
    """Write A at rates and accelerations of all joints, shape (N,); V and S_rate are known."""
    parent, S, S_rate, A = mechanism.parent, workspace.S, workspace.S_rate, workspace.A
    for i in range(len(parent)):
        j = parent[i]
        for k in (0, 3):
            own = rate[i] * triple(S_rate, i, k) + acceleration[i] * triple(S, i, k)
            put(A, i, k, triple(A, j, k) + own if j != BASE else own)


@internal
def move(mechanism: Mechanism, workspace: Workspace, velocity: Array) -> None:
    """Write all rates, motions, and accelerations at none of the actuated joints."""
    joint_rates(mechanism, workspace, velocity)
    motions(mechanism, workspace, workspace.rate)
    clear(workspace.bias)
    accelerations(mechanism, workspace, workspace.rate, workspace.bias)
    bias(mechanism, workspace, workspace.bias)
    accelerations(mechanism, workspace, workspace.rate, workspace.bias)


@kernel
def all_accelerations(
    mechanism: Mechanism, workspace: Workspace, velocity: Array, acceleration: Array, out: Array
) -> None:
    """Write the accelerations of all joints, shape (N,), and their rates to `rate`.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace, at a closed posture.
        velocity: Rates of the actuated joints [rad/s or m/s], shape (n,).
        acceleration: Their accelerations, shape (n,).
        out: Accelerations of all joints, shape (N,).
    """
    move(mechanism, workspace, velocity)
    W = workspace.W
    for i in range(len(out)):
        total = workspace.bias[i]
        for j in range(len(acceleration)):
            total += W[i, j] * acceleration[j]
        out[i] = total
