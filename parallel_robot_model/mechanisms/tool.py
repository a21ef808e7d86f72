"""The pose of the tool and its derivatives, at a closed posture."""

from __future__ import annotations

import math

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cross, internal, kernel, vector
from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    bending,
    clear,
    clear_matrix,
    copy_matrix,
    in_world,
    jacobian_rate,
    nothing,
    of_array,
    rotate_by,
    rotation_vector,
    triple,
    vector_rate,
    vector_rate_by,
    velocity,
)
from parallel_robot_model.mechanisms.workspace import Workspace, factor, solve_vector

ROTATIONS = 3  # the first coordinate of the rotation vector


@kernel
def tool_pose(mechanism: Mechanism, workspace: Workspace, pose: Array) -> None:
    """Write the pose at the closed posture, shape (m,)."""
    update_tool(mechanism, workspace)
    read_pose(mechanism, workspace, pose)


@kernel
def tool_motion(
    mechanism: Mechanism, workspace: Workspace, speed: Array, pose: Array, rate: Array
) -> None:
    """Write pose and rate, and the Jacobian `tool_jacobian`, at a closed posture.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace.
        speed: Rates of the actuated joints [rad/s or m/s], shape (n,).
        pose: Pose [m, rad], shape (m,).
        rate: Its rate, shape (m,).
    """
    update_tool(mechanism, workspace)
    read_pose(mechanism, workspace, pose)
    tool_jacobian(mechanism, workspace, principal_rotation(mechanism, workspace))
    for k in range(len(rate)):
        total = 0.0
        for j in range(len(speed)):
            total += workspace.tool_jacobian[k, j] * speed[j]
        rate[k] = total


@internal
def update_tool(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write point and frame of the tool at the present frames."""
    fixed, frame, i = mechanism.tool_rotation, workspace.tool_frame, mechanism.tool
    point = in_world(workspace.rotation, workspace.origin, i, of_array(mechanism.tool_point))
    for a in range(3):
        workspace.tool_point[a] = point[a]
    for a in range(3):
        for b in range(3):
            if i == BASE:
                frame[0, a, b] = fixed[a, b]
            else:
                R = workspace.rotation[i]
                frame[0, a, b] = (
                    R[a, 0] * fixed[0, b] + R[a, 1] * fixed[1, b] + R[a, 2] * fixed[2, b]
                )


@internal
def principal_rotation(mechanism: Mechanism, workspace: Workspace) -> Array:
    """Rotation vector of the tool, of an angle up to pi [rad]; zeros without a rotation."""
    for k in range(len(mechanism.coordinate)):
        if mechanism.coordinate[k] >= ROTATIONS:
            return rotation_vector(workspace.tool_frame[0], mechanism.tool_home)
    return nothing()


@internal
def rotation_coordinates(
    mechanism: Mechanism, workspace: Workspace, rotation_error: Array
) -> Array:
    """Rotation vector whose rate counts: that from home where only a part of it is asked for.

    Else its rate is the angular velocity, where the tool is not `rotation_error` from where it
    should be.
    """
    if workspace.layout.rotations == 3:
        return rotation_error
    return principal_rotation(mechanism, workspace)


@internal
def read_pose(mechanism: Mechanism, workspace: Workspace, pose: Array) -> None:
    """Write the pose at the present frames of joints and tool."""
    coordinate = mechanism.coordinate
    if len(coordinate) == 0:
        for k in range(len(pose)):
            pose[k] = workspace.trial[mechanism.actuated[k]]
        return
    x = principal_rotation(mechanism, workspace)
    for k in range(len(coordinate)):
        if coordinate[k] < ROTATIONS:
            pose[k] = workspace.tool_point[coordinate[k]]
        elif workspace.layout.rotation_coordinate != 0:
            pose[k] = continued(x[coordinate[k] - ROTATIONS], workspace.angle[0])
        else:
            pose[k] = x[coordinate[k] - ROTATIONS]


@internal
def continued(angle: float, before: float) -> float:
    """The angle plus whole turns that is nearest to one before [rad]."""
    return angle + 2.0 * math.pi * math.floor((before - angle) / (2.0 * math.pi) + 0.5)


@internal
def unwrap_rotation(mechanism: Mechanism, workspace: Workspace) -> bool:
    """Let the only rotation coordinate follow from the posture `here`, beyond pi, too.

    Returns:
        Whether the joints turn little enough to know how the tool does.
    """
    coordinate = workspace.layout.rotation_coordinate
    if coordinate == 0:
        return True
    joint_rotation = 0.0
    for i in range(len(mechanism.turns)):
        if workspace.layout.carries[i]:
            joint_rotation += abs(mechanism.turns[i] * (workspace.trial[i] - workspace.here[i]))
    if not joint_rotation < math.pi:
        return False
    update_tool(mechanism, workspace)
    x = principal_rotation(mechanism, workspace)
    workspace.angle[0] = continued(x[coordinate - ROTATIONS], workspace.angle[0])
    return True


@internal
def tool_jacobian(mechanism: Mechanism, workspace: Workspace, x: Array) -> None:
    """Write the rate of the pose by the actuated joints; `x` is the rotation vector [rad]."""
    out, W, coordinate = workspace.tool_jacobian, workspace.W, mechanism.coordinate
    clear_matrix(out)
    if len(coordinate) == 0:
        for k in range(len(out)):
            out[k, k] = 1.0
        return
    point = of_array(workspace.tool_point)
    i, bent = mechanism.tool, bending(x)
    while i != BASE:
        turn = triple(workspace.S, i)
        slide = velocity(turn, triple(workspace.S, i, 3), point)
        rotation = vector_rate_by(x, bent, turn)
        for k in range(len(coordinate)):
            c = coordinate[k]
            part = slide[c] if c < ROTATIONS else rotation[c - ROTATIONS]
            for j in range(out.shape[1]):
                out[k, j] += part * W[i, j]
        i = mechanism.parent[i]


@internal
def tool_bias(mechanism: Mechanism, workspace: Workspace, x: Array, out: Array) -> None:
    """Write the acceleration of the pose at none of the actuated joints, shape (m,).

    V and A are the motions and such accelerations of the bodies; `x` is the rotation vector.
    """
    coordinate, i = mechanism.coordinate, mechanism.tool
    clear(out)
    if len(coordinate) == 0 or i == BASE:
        return
    point = of_array(workspace.tool_point)
    turning, angular = triple(workspace.V, i), triple(workspace.A, i)
    moving = velocity(turning, triple(workspace.V, i, 3), point)
    linear = velocity(angular, triple(workspace.A, i, 3), point) + cross(turning, moving)
    rate = vector_rate(x, turning)
    rotation = vector_rate(x, angular - jacobian_rate(x, rate))
    for k in range(len(coordinate)):
        c = coordinate[k]
        out[k] = linear[c] if c < ROTATIONS else rotation[c - ROTATIONS]


@internal
def factor_tool(mechanism: Mechanism, workspace: Workspace) -> int:
    """Write the LU of `tool_jacobian`, in units that make its elements numbers.

    Returns:
        Sign of its determinant; 0 where it is singular.
    """
    out = workspace.tool_factors.a
    for k in range(len(out)):
        unit = tool_unit(mechanism, k)
        for j in range(len(out)):
            scale = workspace.layout.scale[mechanism.actuated[j]]
            out[k, j] = unit * workspace.tool_jacobian[k, j] * scale
    return factor(workspace.tool_factors)


@internal
def tool_unit(mechanism: Mechanism, k: int) -> float:
    """What makes a coordinate of the pose a number."""
    if len(mechanism.coordinate) > 0 and mechanism.coordinate[k] < ROTATIONS:
        return 1.0 / mechanism.length
    return 1.0


@internal
def solve_tool(mechanism: Mechanism, workspace: Workspace, out: Array) -> None:
    """Replace a rate of the pose in `tool_error` by that of the actuated joints in `out`."""
    right = workspace.tool_error
    for k in range(len(right)):
        right[k] *= tool_unit(mechanism, k)
    solve_vector(workspace.tool_factors, right)
    for j in range(len(right)):
        out[j] = workspace.layout.scale[mechanism.actuated[j]] * right[j]


# The way of the tool from one pose to another, and how far it is from a share of it.


@internal
def set_target(mechanism: Mechanism, workspace: Workspace, pose: Array) -> None:
    """Set the target pose: write where the way begins and its whole length."""
    begin, way, frame = workspace.tool_way[0], workspace.tool_way[1], workspace.tool_frame
    update_tool(mechanism, workspace)
    read_pose(mechanism, workspace, begin)
    copy_matrix(frame[0], frame[1])
    rotation = nothing()
    if workspace.layout.rotations == 3:
        _target(mechanism, workspace, pose, 1.0)
        rotation = rotation_vector(frame[2], frame[1])
    for k in range(len(pose)):
        c = mechanism.coordinate[k]
        if workspace.layout.rotations == 3 and c >= ROTATIONS:
            way[k] = rotation[c - ROTATIONS]
        else:
            way[k] = pose[k] - begin[k]


@internal
def _target(mechanism: Mechanism, workspace: Workspace, pose: Array, share: float) -> None:
    """Write the frame of the tool at a share of the way."""
    if share >= 1.0:
        rotate_by(rotation_of(mechanism, pose), mechanism.tool_home, workspace.tool_frame[2])
    else:
        turn = share * rotation_of(mechanism, workspace.tool_way[1])
        rotate_by(turn, workspace.tool_frame[1], workspace.tool_frame[2])


@internal
def rotation_of(mechanism: Mechanism, pose: Array) -> Array:
    """Rotation vector in a pose, or in a way of poses; zeros for what it has not."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(len(pose)):
        if mechanism.coordinate[k] == ROTATIONS:
            x = pose[k]
        elif mechanism.coordinate[k] == ROTATIONS + 1:
            y = pose[k]
        elif mechanism.coordinate[k] == ROTATIONS + 2:
            z = pose[k]
    return vector((x, y, z))


@internal
def update_error(mechanism: Mechanism, workspace: Workspace, pose: Array, share: float) -> Array:
    """Write how far the tool is from a share of the way.

    Returns:
        Rotation vector whose rate counts.
    """
    begin, way, error = workspace.tool_way[0], workspace.tool_way[1], workspace.tool_error
    rotation_error = nothing()
    if workspace.layout.rotations == 3:
        _target(mechanism, workspace, pose, share)
        rotation_error = rotation_vector(workspace.tool_frame[0], workspace.tool_frame[2])
    x = rotation_coordinates(mechanism, workspace, rotation_error)
    for k in range(len(pose)):
        c = mechanism.coordinate[k]
        target = pose[k] if share >= 1.0 else begin[k] + share * way[k]
        if c < ROTATIONS:
            error[k] = workspace.tool_point[c] - target
        elif workspace.layout.rotations == 3:
            error[k] = rotation_error[c - ROTATIONS]
        elif workspace.layout.rotations == 1:
            error[k] = continued(x[c - ROTATIONS], target) - target
        else:
            error[k] = x[c - ROTATIONS] - target
    return x


@internal
def add_tool_rate(mechanism: Mechanism, workspace: Workspace, rate: Array) -> None:
    """Add the rate of the pose at rates of the joints, shape (N,), to the error of the tool."""
    point = of_array(workspace.tool_point)
    angular, linear, i = nothing(), nothing(), mechanism.tool
    while i != BASE:
        turn = triple(workspace.S, i)
        slide = velocity(turn, triple(workspace.S, i, 3), point)
        angular = angular + rate[i] * turn
        linear = linear + rate[i] * slide
        i = mechanism.parent[i]
    apart = nothing()
    if workspace.layout.rotations == 3:
        apart = rotation_vector(workspace.tool_frame[0], workspace.tool_frame[2])
    rotation = vector_rate(rotation_coordinates(mechanism, workspace, apart), angular)
    for k in range(len(workspace.pose)):
        c = mechanism.coordinate[k]
        part = linear[c] if c < ROTATIONS else rotation[c - ROTATIONS]
        workspace.tool_error[k] += part
