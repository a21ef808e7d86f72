"""Inverse kinematics: the posture of a pose, continued from the one before, and its motion."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, kernel
from parallel_robot_model.mechanisms.closure_solver import (
    ATTEMPTS,
    BENT,
    EXACT,
    LONGEST,
    NEAR,
    NOISE,
    SHORTEST,
    TRIES,
    close,
    commit_or_restore,
    evaluate_trial,
    finite,
    initialize,
    round_to_grid,
    stop_reason,
)
from parallel_robot_model.mechanisms.closures import derive, errors, evaluate, move, update_frames
from parallel_robot_model.mechanisms.mechanism import (
    FOUND,
    NOT_CLOSED,
    NOT_FINITE,
    SINGULAR,
    Mechanism,
)
from parallel_robot_model.mechanisms.spatial import clear, copy, nothing
from parallel_robot_model.mechanisms.tool import (
    add_tool_rate,
    factor_tool,
    principal_rotation,
    rotation_coordinates,
    rotation_of,
    set_target,
    solve_tool,
    tool_bias,
    tool_jacobian,
    tool_unit,
    unwrap_rotation,
    update_error,
    update_tool,
)
from parallel_robot_model.mechanisms.workspace import SIGN, TOOL_SIGN, Workspace, solve_vector

NEWTONS = 8  # corrections of a step
SHORT = 2e-3  # of a way, in units of the joints, on which derivatives need not be written anew
SMALL = 1e-8  # correction after which the next one is below rounding


@kernel
def solve_pose(mechanism: Mechanism, workspace: Workspace, pose: Array) -> int:
    """Find the posture at a pose, near that of the memory.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace; the memory is the posture found, and stays in a fault.
        pose: Pose [m, rad], shape (m,).

    Returns:
        FOUND, NOT_CLOSED, SINGULAR or NOT_FINITE.
    """
    if len(mechanism.coordinate) == 0:
        fault = close(mechanism, workspace, pose)
        if fault == FOUND:
            copy(pose, workspace.pose)
        return fault
    fault = initialize(mechanism, workspace)
    if fault != FOUND:
        return fault
    if not finite(pose):
        return NOT_FINITE
    angle = workspace.angle[0]
    fault = commit_or_restore(
        mechanism, workspace, _follow_path(mechanism, workspace, pose), angle
    )
    if fault == FOUND:
        copy(pose, workspace.pose)
    return fault


@internal
def _follow_path(mechanism: Mechanism, workspace: Workspace, pose: Array) -> int:
    """Go from the memory to a pose, step by step."""
    copy(workspace.all, workspace.here)
    set_target(mechanism, workspace, pose)
    tool_jacobian(mechanism, workspace, rotation_coordinates(mechanism, workspace, nothing()))
    workspace.state[TOOL_SIGN] = factor_tool(mechanism, workspace)
    if workspace.state[TOOL_SIGN] == 0:
        return SINGULAR
    length = _write_tangent(mechanism, workspace)
    done, share = 0.0, 1.0
    for _ in range(ATTEMPTS):
        if share < SHORTEST:
            break
        last = done + share >= 1.0
        failed = _step(mechanism, workspace, pose, done, share, length)
        if failed == FOUND and last:
            failed = _converge(mechanism, workspace, pose)
        if failed == FOUND and not unwrap_rotation(mechanism, workspace):
            failed = NOT_CLOSED
        if failed != FOUND:
            share *= 0.5
            continue
        if last:
            return FOUND
        copy(workspace.trial, workspace.here)
        done += share
        share = min(1.0 - done, 2.0 * share)
        if not _linearise(mechanism, workspace, pose, done):
            return SINGULAR
        length = _write_tangent(mechanism, workspace)
    driven = 0.0
    for k in range(len(pose)):
        driven = max(driven, tool_unit(mechanism, k) * abs(workspace.tool_way[1, k]))
    return stop_reason(length, driven)


@internal
def _linearise(mechanism: Mechanism, workspace: Workspace, pose: Array, share: float) -> bool:
    """Write errors of closures and tool at the trial, and their derivatives."""
    if evaluate(mechanism, workspace) != workspace.state[SIGN]:
        return False
    derive(mechanism, workspace)
    update_tool(mechanism, workspace)
    x = update_error(mechanism, workspace, pose, share)
    tool_jacobian(mechanism, workspace, x)
    return factor_tool(mechanism, workspace) == workspace.state[TOOL_SIGN]


@internal
def _look(mechanism: Mechanism, workspace: Workspace, pose: Array, share: float) -> None:
    """Write errors of closures and tool at the trial; the derivatives are those before."""
    update_frames(mechanism, workspace)
    errors(mechanism, workspace)
    update_tool(mechanism, workspace)
    update_error(mechanism, workspace, pose, share)


@internal
def _write_tangent(mechanism: Mechanism, workspace: Workspace) -> float:
    """Write the derivative of all joints by the share of the way."""
    way = workspace.way
    for k in range(len(workspace.pose)):
        workspace.tool_error[k] = workspace.tool_way[1, k]
    solve_tool(mechanism, workspace, workspace.tool_bias)
    length = 0.0
    for i in range(len(workspace.trial)):
        way[0, i] = 0.0
        for j in range(len(workspace.pose)):
            way[0, i] += workspace.W[i, j] * workspace.tool_bias[j]
        length = max(length, abs(way[0, i]) / workspace.layout.scale[i])
    return length


@internal
def _step(
    mechanism: Mechanism,
    workspace: Workspace,
    pose: Array,
    done: float,
    share: float,
    length: float,
) -> int:
    """Go a share of the way, and correct joints until loops are closed and the tool is there."""
    before = share * length
    if not before <= LONGEST:
        return NOT_CLOSED
    for i in range(len(workspace.trial)):
        workspace.trial[i] = workspace.here[i] + share * workspace.way[0, i]
    chords = done == 0.0 and before <= SHORT
    for _ in range(NEWTONS):
        if chords:
            _look(mechanism, workspace, pose, share)
        elif not _linearise(mechanism, workspace, pose, done + share):
            return SINGULAR
        size = _correct(mechanism, workspace)
        if not size <= BENT * before + NOISE:
            return NOT_CLOSED
        if chords and (size <= NEAR or size * size <= NEAR * before):  # what the next one were
            return FOUND
        if not chords and (size <= SMALL or size * (size / before) ** 2 <= EXACT):
            return FOUND
        chords = chords and size <= SHORT * before
        before = size
    return NOT_CLOSED


@internal
def _correct(mechanism: Mechanism, workspace: Workspace) -> float:
    """Correct the trial by the errors of closures and tool together."""
    layout, single, trial = workspace.layout, workspace.single, workspace.trial
    rate, size = workspace.rate, 0.0
    clear(rate)
    for k in range(len(single)):
        single[k] = workspace.error[k]
    solve_vector(workspace.factors, single)
    for c in range(len(single)):
        rate[layout.passive[c]] = -layout.scale[layout.passive[c]] * single[c]
    add_tool_rate(mechanism, workspace, rate)
    solve_tool(mechanism, workspace, workspace.tool_bias)
    for i in range(len(trial)):
        for j in range(len(workspace.pose)):
            rate[i] -= workspace.W[i, j] * workspace.tool_bias[j]
        trial[i] += rate[i]
        if not math.isfinite(rate[i]):
            return np.inf
        size = max(size, abs(rate[i]) / layout.scale[i])
    return size


@internal
def _converge(mechanism: Mechanism, workspace: Workspace, pose: Array) -> int:
    """Reach the pose such that the last bits of the trial do not matter; write W."""
    for _ in range(1 + TRIES):
        round_to_grid(workspace, workspace.layout.moving)
        if not _linearise(mechanism, workspace, pose, 1.0):
            return SINGULAR
        if not _correct(mechanism, workspace) < np.inf:
            return NOT_FINITE
        if _was_nearest(workspace):
            break
    return evaluate_trial(mechanism, workspace, True)


@internal
def _was_nearest(workspace: Workspace) -> bool:
    """Whether the trial before its correction was the point of the grid next to it."""
    rate, grid = workspace.rate, workspace.layout.grid
    nearest = True
    for i in range(len(rate)):
        nearest &= abs(rate[i]) <= 0.5 * grid[i]
    return nearest


# Rates and accelerations of the actuated joints at those of the pose.


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
    update_tool(mechanism, workspace)
    x = rotation_of(mechanism, workspace.pose)  # as it was asked for, where all of it was
    if workspace.layout.rotations != 3:
        x = principal_rotation(mechanism, workspace)
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
