"""Rates and accelerations of the actuated joints at those of the pose."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.mechanisms.closures import move
from parallel_robot_model.mechanisms.mechanism import FOUND, SINGULAR, Mechanism
from parallel_robot_model.mechanisms.spatial import Triple, copy
from parallel_robot_model.mechanisms.tool import (
    ROTATIONS,
    factor_tool,
    place_tool,
    principal_rotation,
    solve_tool,
    tool_bias,
    tool_jacobian,
)
from parallel_robot_model.mechanisms.workspace import Workspace


@kernel
def pose_motion(
    mechanism: Mechanism,
    workspace: Workspace,
    rate: Array,
    acceleration: Array,
    position: Array,
    velocity: Array,
    acceleration_out: Array,
) -> int:
    """Write the motion of the actuated joints at the pose that was solved last.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace, after `solve_pose`.
        rate: Rate of the pose [m/s, rad/s], shape (m,).
        acceleration: Its second derivative, shape (m,).
        position: Actuated joints [rad or m], shape (n,).
        velocity: Their rates, shape (n,).
        acceleration_out: Their accelerations, shape (n,).

    Returns:
        FOUND, or SINGULAR, where no rates are found: NaN.
    """
    right = workspace.tool_error
    copy(workspace.q, position)
    place_tool(mechanism, workspace)
    x = _rotation(mechanism, workspace)
    tool_jacobian(mechanism, workspace, x)
    if factor_tool(mechanism, workspace) == 0:
        velocity[:] = np.nan
        acceleration_out[:] = np.nan
        return SINGULAR
    for k in range(len(rate)):
        right[k] = rate[k]
    solve_tool(mechanism, workspace, velocity)
    move(mechanism, workspace, velocity)
    tool_bias(mechanism, workspace, x, workspace.tool_bias)
    for k in range(len(rate)):
        right[k] = acceleration[k] - workspace.tool_bias[k]
    solve_tool(mechanism, workspace, acceleration_out)
    return FOUND


@inner
def _rotation(mechanism: Mechanism, workspace: Workspace) -> Triple:
    """Rotation vector of the pose [rad]; as it was asked for, where all of it was."""
    if workspace.layout.rotations != 3:
        return principal_rotation(mechanism, workspace)
    x, y, z = 0.0, 0.0, 0.0
    for k in range(len(mechanism.coordinate)):
        if mechanism.coordinate[k] == ROTATIONS:
            x = workspace.pose[k]
        elif mechanism.coordinate[k] == ROTATIONS + 1:
            y = workspace.pose[k]
        elif mechanism.coordinate[k] == ROTATIONS + 2:
            z = workspace.pose[k]
    return x, y, z
