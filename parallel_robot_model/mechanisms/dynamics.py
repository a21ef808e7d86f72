"""The equations of motion in the actuated joints: M a + Q v + gravity = torque.

With M and C of the open tree, Mdot - 2 C skew-symmetric, and W, the rates of all joints by those
of the actuated ones: M = W^T M W, Q = W^T (C W + M dW/dt), gravity = W^T g. Mdot - 2 Q is then
skew-symmetric, too.

Source:
    Echeandia, Wensing (2021), Numerical methods to compute the Coriolis matrix and Christoffel
    symbols for rigid-body systems, J. Comput. Nonlinear Dyn. 16(9), algorithm 1; the matrix B of
    a body is [[D - n x / 2, 0], [-f x, 0]] about the world's origin, with D, n, f of `bodies`.
"""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.mechanisms.bodies import (
    momentum_of,
    place_bodies,
    place_momenta,
    symmetric,
)
from parallel_robot_model.mechanisms.closures import derive_rate, joint_rates, motions
from parallel_robot_model.mechanisms.mechanism import BASE, HELD, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    Triple,
    clear_matrix,
    crossed,
    inner_product,
    minus,
    plus,
    second_triple,
    times,
    triple,
)
from parallel_robot_model.mechanisms.workspace import Workspace


@kernel
def model(
    mechanism: Mechanism,
    workspace: Workspace,
    velocity: Array,
    M: Array,
    Q: Array,
    gravity: Array,
) -> None:
    """Write the model at the closed posture of the workspace.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace.
        velocity: Rates of the actuated joints [rad/s or m/s], shape (n,).
        M: Inertia matrix [kg m^2, kg m or kg], shape (n, n).
        Q: Coriolis and centrifugal matrix, shape (n, n); Mdot - 2 Q is skew-symmetric.
        gravity: Torque or force that holds the machine still [N m or N], shape (n,).
    """
    joint_rates(mechanism, workspace, velocity)
    motions(mechanism, workspace, workspace.rate)
    derive_rate(mechanism, workspace)
    place_bodies(mechanism, workspace)
    place_momenta(workspace)
    _products(mechanism, workspace)
    reduce_matrix(mechanism, workspace, workspace.MW, M)
    for a in range(len(M)):
        for b in range(a):
            M[a, b] = M[b, a]
    reduce_matrix(mechanism, workspace, workspace.QW, Q)
    reduce_vector(mechanism, workspace, workspace.load, gravity)


@inner
def _products(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write MW, QW and the forces against gravity; bodies become composite ones."""
    S, S_rate, inertia, momentum = (
        workspace.S, workspace.S_rate, workspace.inertia, workspace.momentum,
    )  # fmt: skip
    W, W_rate, MW, QW = workspace.W, workspace.W_rate, workspace.MW, workspace.QW
    parent, column, n = mechanism.parent, workspace.layout.column, W.shape[1]
    clear_matrix(MW)
    clear_matrix(QW)
    for i in range(len(parent) - 1, -1, -1):
        if column[i] != HELD:
            turn, slide = triple(S, i), second_triple(S, i)
            workspace.load[i] = weight(mechanism, inertia, i, turn, slide)
            n_own, f_own = momentum_of(inertia, i, turn, slide)
            n_rate, f_rate = momentum_of(inertia, i, triple(S_rate, i), second_triple(S_rate, i))
            n_body = (momentum[i, 6], momentum[i, 7], momentum[i, 8])
            f_body = (momentum[i, 9], momentum[i, 10], momentum[i, 11])
            half, across = symmetric(momentum, i, 0, turn), times(crossed(n_body, turn), 0.5)
            n_rate = plus(n_rate, minus(half, across))
            f_rate = minus(f_rate, crossed(f_body, turn))
            back = plus(plus(half, across), crossed(f_body, slide))
            j = i
            while j != BASE:
                if column[j] != HELD:
                    turn_j, slide_j = triple(S, j), second_triple(S, j)
                    m_ij = inner_product(turn_j, n_own) + inner_product(slide_j, f_own)
                    c_ji = inner_product(turn_j, n_rate) + inner_product(slide_j, f_rate)
                    if i == j:
                        m_ij += mechanism.armature[i]
                        for k in range(n):
                            MW[i, k] += m_ij * W[i, k]
                            QW[i, k] += c_ji * W[i, k] + m_ij * W_rate[i, k]
                    else:
                        c_ij = (
                            inner_product(triple(S_rate, j), n_own)
                            + inner_product(second_triple(S_rate, j), f_own)
                            + inner_product(turn_j, back)
                        )
                        for k in range(n):
                            MW[i, k] += m_ij * W[j, k]
                            MW[j, k] += m_ij * W[i, k]
                            QW[i, k] += c_ij * W[j, k] + m_ij * W_rate[j, k]
                            QW[j, k] += c_ji * W[i, k] + m_ij * W_rate[i, k]
                j = parent[j]
        j = parent[i]
        if j != BASE:
            for k in range(10):
                inertia[j, k] += inertia[i, k]
            for k in range(12):
                momentum[j, k] += momentum[i, k]


@inner
def weight(mechanism: Mechanism, inertia: Array, i: int, turn: Triple, slide: Triple) -> float:
    """Force of joint i against the gravity of the composite body."""
    down = (mechanism.gravity[0], mechanism.gravity[1], mechanism.gravity[2])
    h = (inertia[i, 1], inertia[i, 2], inertia[i, 3])
    return -inner_product(turn, crossed(h, down)) - inertia[i, 0] * inner_product(slide, down)


@inner
def reduce_matrix(mechanism: Mechanism, workspace: Workspace, x: Array, out: Array) -> None:
    """Write W^T x, shape (n, n), x of shape (N, n)."""
    actuated, passive, W = mechanism.actuated, workspace.layout.passive, workspace.W
    n = len(actuated)
    for a in range(n):
        for b in range(n):
            out[a, b] = x[actuated[a], b]
    for c in range(len(passive)):
        i = passive[c]
        for a in range(n):
            for b in range(n):
                out[a, b] += W[i, a] * x[i, b]


@inner
def reduce_vector(mechanism: Mechanism, workspace: Workspace, x: Array, out: Array) -> None:
    """Write W^T x, shape (n,), x of shape (N,)."""
    actuated, passive, W = mechanism.actuated, workspace.layout.passive, workspace.W
    for a in range(len(actuated)):
        total = x[actuated[a]]
        for c in range(len(passive)):
            total += W[passive[c], a] * x[passive[c]]
        out[a] = total
