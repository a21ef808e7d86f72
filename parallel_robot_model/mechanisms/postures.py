"""Many samples at once: postures, and frames for pictures."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.mechanisms.closing import close, go_back
from parallel_robot_model.mechanisms.closures import place
from parallel_robot_model.mechanisms.mechanism import FOUND, Index, Mechanism
from parallel_robot_model.mechanisms.spatial import copy, copy_matrix
from parallel_robot_model.mechanisms.workspace import PLACED, Workspace


@kernel
def postures(
    mechanism: Mechanism, workspace: Workspace, q: Array, positions: Array, fault: Index
) -> None:
    """Find the postures of a motion, each from the last one that was found.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace.
        q: Actuated joints [rad or m], shape (K, n).
        positions: All joints, shape (K, N); NaN in a fault.
        fault: FOUND or the fault of each sample, shape (K,).
    """
    for k in range(len(q)):
        fault[k] = close(mechanism, workspace, q[k])
        for i in range(positions.shape[1]):
            positions[k, i] = workspace.all[i] if fault[k] == FOUND else np.nan


@kernel
def frames(
    mechanism: Mechanism, workspace: Workspace, positions: Array, rotation: Array, origin: Array
) -> None:
    """Write the frames of all joints in the world at many postures.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace.
        positions: All joints [rad or m], shape (K, N).
        rotation: Their frames, shape (K, N, 3, 3).
        origin: Their origins [m], shape (K, N, 3).
    """
    for k in range(len(positions)):
        copy(positions[k], workspace.trial)
        place(mechanism, workspace)
        for i in range(rotation.shape[1]):
            copy_matrix(workspace.rotation[i], rotation[k, i])
        copy_matrix(workspace.origin, origin[k])
    if workspace.state[PLACED] != 0:
        go_back(mechanism, workspace, workspace.angle[0])
