"""The posture that a workspace keeps, and how a new one becomes it.

Its last bits do not tell where it was looked for: passive positions are rounded to a grid, from
which the last step is the same for all.
"""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.closures import derive, place, settle
from parallel_robot_model.mechanisms.mechanism import FOUND, NOT_CLOSED, SINGULAR, Index, Mechanism
from parallel_robot_model.mechanisms.spatial import copy
from parallel_robot_model.mechanisms.tool import follow
from parallel_robot_model.mechanisms.workspace import PLACED, SIGN, Workspace, solve_vector

CLOSED = 1e-12  # error of a closed posture, in units of the length
POLISHED = 1e-13  # and at which no further step is needed
TRIES = 2  # of other points of the grid, where the trial was not near enough to know its own


@inner
def begin_at_memory(mechanism: Mechanism, workspace: Workspace) -> int:
    """Place the joints at the memory if that is not done yet."""
    if workspace.state[PLACED] != 0:
        return FOUND
    copy(workspace.all, workspace.trial)
    copy(workspace.all, workspace.here)
    fault = arrive(mechanism, workspace)
    if fault == FOUND:
        follow(mechanism, workspace)
        remember(mechanism, workspace)
        workspace.state[PLACED] = 1
    return fault


@inner
def remember(mechanism: Mechanism, workspace: Workspace) -> None:
    """Let the memory be the trial."""
    copy(workspace.trial, workspace.all)
    for j in range(len(workspace.q)):
        workspace.q[j] = workspace.trial[mechanism.actuated[j]]


@inner
def go_back(mechanism: Mechanism, workspace: Workspace, angle: float) -> None:
    """Place the joints at the memory again."""
    workspace.angle[0] = angle
    copy(workspace.all, workspace.trial)
    settle(mechanism, workspace)
    derive(mechanism, workspace)


@inner
def arrive(mechanism: Mechanism, workspace: Workspace) -> int:
    """Close the loops near the trial, such that its last bits do not matter; write W."""
    r = len(workspace.error)
    if r == 0:
        place(mechanism, workspace)
        workspace.state[SIGN] = 1
        return FOUND
    steps, tries = 0, 0
    round_to_grid(workspace, workspace.layout.passive)
    while steps < 4:
        sign = settle(mechanism, workspace)
        if sign == 0:
            return SINGULAR
        largest = 0.0
        for row in range(r):
            largest = max(largest, abs(workspace.error[row]))
        if steps > 0 and largest <= (POLISHED if steps < 3 else CLOSED):
            workspace.state[SIGN] = sign
            derive(mechanism, workspace)
            return FOUND
        correct(workspace)
        if steps == 0 and tries < TRIES and not _was_nearest(workspace):
            round_to_grid(workspace, workspace.layout.passive)
            tries += 1
        else:
            steps += 1
    return NOT_CLOSED


@inner
def round_to_grid(workspace: Workspace, joints: Index) -> None:
    """Round some joints of the trial to their grid."""
    grid, trial = workspace.layout.grid, workspace.trial
    for c in range(len(joints)):
        i = joints[c]
        trial[i] = grid[i] * np.rint(trial[i] / grid[i])


@inner
def _was_nearest(workspace: Workspace) -> bool:
    """Whether the trial before its correction was the point of the grid next to it."""
    passive, grid, scale = workspace.layout.passive, workspace.layout.grid, workspace.layout.scale
    nearest = True
    for c in range(len(passive)):
        i = passive[c]
        nearest &= abs(scale[i] * workspace.single[c]) <= 0.5 * grid[i]
    return nearest


@inner
def correct(workspace: Workspace) -> float:
    """Correct the trial by its errors.

    Returns:
        The largest correction of a joint, in its units.
    """
    single, layout = workspace.single, workspace.layout
    for k in range(len(single)):
        single[k] = workspace.error[k]
    solve_vector(workspace.factors, single)
    size = 0.0
    for c in range(len(single)):
        i = layout.passive[c]
        workspace.trial[i] -= layout.scale[i] * single[c]
        size = max(size, abs(single[c]))
        if math.isnan(single[c]):
            return np.nan
    return size
