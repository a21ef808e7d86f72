"""The way of the tool from one pose to another, and how far it is from a share of it."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    Triple,
    copy_matrix,
    plus,
    rotation_vector,
    second_triple,
    times,
    triple,
    turn_by,
    vector_rate,
    velocity,
)
from parallel_robot_model.mechanisms.tool import (
    ROTATIONS,
    continued,
    place_tool,
    read_pose,
    turning,
)
from parallel_robot_model.mechanisms.workspace import Workspace


@inner
def aim(mechanism: Mechanism, workspace: Workspace, pose: Array) -> None:
    """Write where the way begins and its whole length."""
    begin, way, frame = workspace.tool_way[0], workspace.tool_way[1], workspace.tool_frame
    place_tool(mechanism, workspace)
    read_pose(mechanism, workspace, begin)
    copy_matrix(frame[0], frame[1])
    turn = (0.0, 0.0, 0.0)
    if workspace.layout.rotations == 3:
        _target(mechanism, workspace, pose, 1.0)
        turn = rotation_vector(frame[2], frame[1])
    for k in range(len(pose)):
        c = mechanism.coordinate[k]
        if workspace.layout.rotations == 3 and c >= ROTATIONS:
            way[k] = turn[c - ROTATIONS]
        else:
            way[k] = pose[k] - begin[k]


@inner
def _target(mechanism: Mechanism, workspace: Workspace, pose: Array, share: float) -> None:
    """Write the frame of the tool at a share of the way."""
    vector = pose if share >= 1.0 else workspace.tool_way[1]
    x, y, z = 0.0, 0.0, 0.0
    for k in range(len(pose)):
        if mechanism.coordinate[k] == ROTATIONS:
            x = vector[k]
        elif mechanism.coordinate[k] == ROTATIONS + 1:
            y = vector[k]
        elif mechanism.coordinate[k] == ROTATIONS + 2:
            z = vector[k]
    if share >= 1.0:
        turn_by((x, y, z), mechanism.tool_home, workspace.tool_frame[2])
    else:
        way = times((x, y, z), share)
        turn_by(way, workspace.tool_frame[1], workspace.tool_frame[2])


@inner
def miss(mechanism: Mechanism, workspace: Workspace, pose: Array, share: float) -> Triple:
    """Write how far the tool is from a share of the way.

    Returns:
        Rotation vector whose rate counts.
    """
    begin, way, error = workspace.tool_way[0], workspace.tool_way[1], workspace.tool_error
    apart = (0.0, 0.0, 0.0)
    if workspace.layout.rotations == 3:
        _target(mechanism, workspace, pose, share)
        apart = rotation_vector(workspace.tool_frame[0], workspace.tool_frame[2])
    x = turning(mechanism, workspace, apart)
    for k in range(len(pose)):
        c = mechanism.coordinate[k]
        target = pose[k] if share >= 1.0 else begin[k] + share * way[k]
        if c < ROTATIONS:
            error[k] = workspace.tool_point[c] - target
        elif workspace.layout.rotations == 3:
            error[k] = apart[c - ROTATIONS]
        elif workspace.layout.rotations == 1:
            error[k] = continued(x[c - ROTATIONS], target) - target
        else:
            error[k] = x[c - ROTATIONS] - target
    return x


@inner
def add_tool_rate(mechanism: Mechanism, workspace: Workspace, rate: Array) -> None:
    """Add the rate of the pose at rates of the joints, shape (N,), to the error of the tool."""
    point = (workspace.tool_point[0], workspace.tool_point[1], workspace.tool_point[2])
    angular, linear, i = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), mechanism.tool
    while i != BASE:
        turn = triple(workspace.S, i)
        slide = velocity(turn, second_triple(workspace.S, i), point)
        angular = plus(angular, times(turn, rate[i]))
        linear = plus(linear, times(slide, rate[i]))
        i = mechanism.parent[i]
    apart = (0.0, 0.0, 0.0)
    if workspace.layout.rotations == 3:
        apart = rotation_vector(workspace.tool_frame[0], workspace.tool_frame[2])
    rotation = vector_rate(turning(mechanism, workspace, apart), angular)
    for k in range(len(workspace.pose)):
        c = mechanism.coordinate[k]
        part = linear[c] if c < ROTATIONS else rotation[c - ROTATIONS]
        workspace.tool_error[k] += part
