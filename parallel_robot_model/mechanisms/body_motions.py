"""Motions of all bodies over many samples, for equations that are set up outside kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.mechanisms.closing import close
from parallel_robot_model.mechanisms.closures import accelerations, all_accelerations
from parallel_robot_model.mechanisms.mechanism import FOUND, Index, Mechanism
from parallel_robot_model.mechanisms.workspace import Workspace, boxed


class BodyMotions(NamedTuple):
    """Motions of N bodies at K samples; spatial vectors are angular, then linear at the origin.

    Attributes:
        fault: FOUND or a fault of each sample, shape (K,).
        rotation: Frames of the bodies in the world, shape (K, N, 3, 3).
        origin: Their origins [m], shape (K, N, 3).
        S: Motion by each joint in the world, shape (K, N, 6).
        W: Rates of all joints by those of the actuated ones, shape (K, N, n).
        V: Velocities of the bodies, shape (K, N, 6).
        A: Their accelerations, shape (K, N, 6).
        joint: Accelerations of the joints, shape (K, N).
    """

    fault: Index
    rotation: Array
    origin: Array
    S: Array
    W: Array
    V: Array
    A: Array
    joint: Array


def body_motions(
    mechanism: Mechanism, position: Array, velocity: Array, acceleration: Array
) -> BodyMotions:
    """Motions of the bodies at positions, rates and accelerations of the actuated joints, (K, n).

    Each posture is looked for from the one before, the first from home.
    """
    (K, n), N = position.shape, len(mechanism.parent)
    shapes = (N, 3, 3), (N, 3), (N, 6), (N, n), (N, 6), (N, 6), (N,)
    out = BodyMotions(np.zeros(K, np.int64), *(np.zeros((K, *shape)) for shape in shapes))
    q, rate, change = (
        np.ascontiguousarray(x, np.float64) for x in (position, velocity, acceleration)
    )
    _record(*boxed(mechanism), q, rate, change, out)
    return out


@kernel
def _record(
    mechanism: Mechanism,
    workspace: Workspace,
    position: Array,
    velocity: Array,
    acceleration: Array,
    out: BodyMotions,
) -> None:
    """Write the motions sample by sample."""
    for k in range(len(position)):
        out.fault[k] = close(mechanism, workspace, position[k])
        if out.fault[k] != FOUND:
            continue
        joint = out.joint[k]
        all_accelerations(mechanism, workspace, velocity[k], acceleration[k], joint)
        accelerations(mechanism, workspace, workspace.rate, joint)
        for i in range(len(joint)):
            for a in range(3):
                out.origin[k, i, a] = workspace.origin[i, a]
                for b in range(3):
                    out.rotation[k, i, a, b] = workspace.rotation[i, a, b]
            for a in range(6):
                out.S[k, i, a] = workspace.S[i, a]
                out.V[k, i, a] = workspace.V[i, a]
                out.A[k, i, a] = workspace.A[i, a]
            for j in range(velocity.shape[1]):
                out.W[k, i, j] = workspace.W[i, j]
