"""Accelerations of the actuated joints under torques, without the Coriolis matrix."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.mechanisms.bodies import momentum_of, place_bodies
from parallel_robot_model.mechanisms.closures import move
from parallel_robot_model.mechanisms.dynamics import reduce_matrix, reduce_vector
from parallel_robot_model.mechanisms.mechanism import BASE, HELD, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    clear_matrix,
    crossed,
    inner_product,
    minus,
    plus,
    second_triple,
    set_row,
    triple,
)
from parallel_robot_model.mechanisms.workspace import Workspace, solve_symmetric


@kernel
def acceleration(
    mechanism: Mechanism, workspace: Workspace, velocity: Array, torque: Array, out: Array
) -> None:
    """Write the accelerations of the actuated joints at the closed posture.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace.
        velocity: Rates of the actuated joints [rad/s or m/s], shape (n,).
        torque: Torques or forces at them [N m or N], shape (n,).
        out: Their accelerations [rad/s^2 or m/s^2], shape (n,); not finite where the inertia
            matrix is not positive definite.
    """
    move(mechanism, workspace, velocity)
    place_bodies(mechanism, workspace)
    _forces(mechanism, workspace)
    reduce_vector(mechanism, workspace, workspace.load, out)
    for j in range(len(out)):
        out[j] = torque[j] - out[j]
    _products(mechanism, workspace)
    reduce_matrix(mechanism, workspace, workspace.MW, workspace.inertia_matrix)
    solve_symmetric(workspace.inertia_matrix, out)


@inner
def _forces(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write the forces of all joints at the motion of the bodies, by Newton and Euler."""
    V, A, inertia, force = workspace.V, workspace.A, workspace.inertia, workspace.force
    parent, load = mechanism.parent, workspace.load
    down = (mechanism.gravity[0], mechanism.gravity[1], mechanism.gravity[2])
    for i in range(len(parent)):
        turning, moving = triple(V, i), second_triple(V, i)
        n, f = momentum_of(inertia, i, turning, moving)
        n_rate, f_rate = momentum_of(inertia, i, triple(A, i), minus(second_triple(A, i), down))
        n_bent = plus(crossed(turning, n), crossed(moving, f))
        set_row(force, i, plus(n_rate, n_bent), plus(f_rate, crossed(turning, f)))
    for i in range(len(parent) - 1, -1, -1):
        turn, slide = triple(workspace.S, i), second_triple(workspace.S, i)
        load[i] = inner_product(turn, triple(force, i)) + inner_product(
            slide, second_triple(force, i)
        )
        load[i] += mechanism.armature[i] * workspace.bias[i]
        j = parent[i]
        if j != BASE:
            for k in range(6):
                force[j, k] += force[i, k]


@inner
def _products(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write MW; bodies become composite ones."""
    S, inertia, W, MW = workspace.S, workspace.inertia, workspace.W, workspace.MW
    parent, column, n = mechanism.parent, workspace.layout.column, W.shape[1]
    clear_matrix(MW)
    for i in range(len(parent) - 1, -1, -1):
        if column[i] != HELD:
            n_own, f_own = momentum_of(inertia, i, triple(S, i), second_triple(S, i))
            j = i
            while j != BASE:
                if column[j] != HELD:
                    m_ij = inner_product(triple(S, j), n_own) + inner_product(
                        second_triple(S, j), f_own
                    )
                    if i == j:
                        m_ij += mechanism.armature[i]
                    for k in range(n):
                        MW[i, k] += m_ij * W[j, k]
                    if i != j:
                        for k in range(n):
                            MW[j, k] += m_ij * W[i, k]
                j = parent[j]
        j = parent[i]
        if j != BASE:
            for k in range(10):
                inertia[j, k] += inertia[i, k]
