"""The equations of motion in the actuated joints: M a + Q v + gravity = torque.

With M and C of the open tree, Mdot - 2 C skew-symmetric, and W, the rates of all joints by those
of the actuated ones: M = W^T M W, Q = W^T (C W + M dW/dt), gravity = W^T g. Mdot - 2 Q is then
skew-symmetric, too. `gravity` has the passive forces of springs and dampers, too.

Source:
    Echeandia, Wensing (2021), Numerical methods to compute the Coriolis matrix and Christoffel
    symbols for rigid-body systems, J. Comput. Nonlinear Dyn. 16(9), algorithm 1; the matrix B of
    a body is [[D - n x / 2, 0], [-f x, 0]] about the world's origin, with D, n, f as below.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cross, dot, internal, kernel, vector
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.closures import (
    accelerations,
    all_accelerations,
    derive_rate,
    joint_rates,
    motions,
    move,
)
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, LOCKED, Index, Mechanism
from parallel_robot_model.mechanisms.passive import (
    add_bias,
    add_coriolis,
    add_inertia,
    add_loads,
)
from parallel_robot_model.mechanisms.spatial import (
    clear_matrix,
    in_world,
    matrix,
    of_array,
    put,
    triple,
)
from parallel_robot_model.mechanisms.workspace import Workspace, boxed, solve_symmetric

# Inertia of the bodies in the world, about its origin; composite ones are sums.
#
# Of a body with mass m, first moments h, second moments J that moves with V = (w, u): linear
# momentum f = m u + w x h, angular momentum n = J w + h x u, and half the derivative of J, D.


@internal
def update_inertias(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write `inertia` of each body: m, h, J by its rows xx xy xz yy yz zz."""
    out, rotation = workspace.inertia, workspace.rotation
    for i in range(len(mechanism.mass)):
        mass = mechanism.mass[i]
        at = in_world(rotation, workspace.origin, i, triple(mechanism.centre, i))
        R, own, x, y, z = matrix(rotation[i]), matrix(mechanism.inertia[i]), at[0], at[1], at[2]
        out[i, 0] = mass
        put(out, i, 1, mass * at)
        a, b, c = own @ R[0], own @ R[1], own @ R[2]
        out[i, 4] = dot(R[0], a) + mass * (y * y + z * z)
        out[i, 5] = dot(R[1], a) - mass * x * y
        out[i, 6] = dot(R[2], a) - mass * x * z
        out[i, 7] = dot(R[1], b) + mass * (x * x + z * z)
        out[i, 8] = dot(R[2], b) - mass * y * z
        out[i, 9] = dot(R[2], c) + mass * (x * x + y * y)


@internal
def symmetric(x: Array, i: int, k: int) -> Array:
    """The symmetric matrix in row i from element k."""
    second = vector((x[i, k + 1], x[i, k + 3], x[i, k + 4]))
    third = vector((x[i, k + 2], x[i, k + 4], x[i, k + 5]))
    return vector((triple(x, i, k), second, third))


@internal
def momentum_of(
    inertia: Array, i: int, angular_part: Array, linear_part: Array
) -> tuple[Array, Array]:
    """Angular and linear momentum of body i in a motion."""
    h = triple(inertia, i, 1)
    angular = symmetric(inertia, i, 4) @ angular_part + cross(h, linear_part)
    return angular, inertia[i, 0] * linear_part + cross(angular_part, h)


@internal
def update_momenta(workspace: Workspace) -> None:
    """Write `momentum` of each body: D by its rows xx xy xz yy yz zz, n, f."""
    inertia, out = workspace.inertia, workspace.momentum
    for i in range(len(inertia)):
        w, u = triple(workspace.V, i), triple(workspace.V, i, 3)
        n, f = momentum_of(inertia, i, w, u)
        h, J = triple(inertia, i, 1), symmetric(inertia, i, 4)
        # D = sym(w x J) - sym(h u^T) + (h u) 1
        a, b, c, along = cross(w, J[0]), cross(w, J[1]), cross(w, J[2]), dot(h, u)
        out[i, 0] = a[0] - h[0] * u[0] + along
        out[i, 1] = 0.5 * (a[1] + b[0] - h[0] * u[1] - h[1] * u[0])
        out[i, 2] = 0.5 * (a[2] + c[0] - h[0] * u[2] - h[2] * u[0])
        out[i, 3] = b[1] - h[1] * u[1] + along
        out[i, 4] = 0.5 * (b[2] + c[1] - h[1] * u[2] - h[2] * u[1])
        out[i, 5] = c[2] - h[2] * u[2] + along
        put(out, i, 6, n)
        put(out, i, 9, f)


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
        gravity: Torque or force against gravity, springs and dampers [N m or N], shape (n,).
    """
    joint_rates(mechanism, workspace, velocity)
    motions(mechanism, workspace, workspace.rate)
    derive_rate(mechanism, workspace)
    update_inertias(mechanism, workspace)
    update_momenta(workspace)
    _products(mechanism, workspace)
    add_loads(mechanism, workspace)
    add_inertia(mechanism, workspace, workspace.W, workspace.MW)
    add_inertia(mechanism, workspace, workspace.W_rate, workspace.QW)
    add_coriolis(mechanism, workspace)
    reduce_matrix(mechanism, workspace, workspace.MW, M)
    for a in range(len(M)):
        for b in range(a):
            M[a, b] = M[b, a]
    reduce_matrix(mechanism, workspace, workspace.QW, Q)
    reduce_vector(mechanism, workspace, workspace.load, gravity)


@internal
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
        if column[i] != LOCKED:
            turn, slide = triple(S, i), triple(S, i, 3)
            workspace.load[i] = weight(mechanism, inertia, i, turn, slide)
            n_own, f_own = momentum_of(inertia, i, turn, slide)
            n_rate, f_rate = momentum_of(inertia, i, triple(S_rate, i), triple(S_rate, i, 3))
            n_body, f_body = triple(momentum, i, 6), triple(momentum, i, 9)
            half, across = symmetric(momentum, i, 0) @ turn, 0.5 * cross(n_body, turn)
            n_rate = n_rate + (half - across)
            f_rate = f_rate - cross(f_body, turn)
            back = (half + across) + cross(f_body, slide)
            j = i
            while j != BASE:
                if column[j] != LOCKED:
                    m_ij = power(S, j, n_own, f_own)
                    c_ji = power(S, j, n_rate, f_rate)
                    if i == j:
                        m_ij += mechanism.armature[i]
                        for k in range(n):
                            MW[i, k] += m_ij * W[i, k]
                            QW[i, k] += c_ji * W[i, k] + m_ij * W_rate[i, k]
                    else:
                        c_ij = power(S_rate, j, n_own, f_own) + dot(triple(S, j), back)
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


@internal
def power(motion: Array, i: int, n: Array, f: Array) -> float:
    """Angular momentum n times the turning of motion i, plus linear momentum f times its slide."""
    return dot(triple(motion, i), n) + dot(triple(motion, i, 3), f)


@internal
def weight(
    mechanism: Mechanism, inertia: Array, i: int, angular_part: Array, linear_part: Array
) -> float:
    """Force of joint i against the gravity of the composite body."""
    down = of_array(mechanism.gravity)
    return -dot(angular_part, cross(triple(inertia, i, 1), down)) - inertia[i, 0] * dot(
        linear_part, down
    )


@internal
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


@internal
def reduce_vector(mechanism: Mechanism, workspace: Workspace, x: Array, out: Array) -> None:
    """Write W^T x, shape (n,), x of shape (N,)."""
    actuated, passive, W = mechanism.actuated, workspace.layout.passive, workspace.W
    for a in range(len(actuated)):
        total = x[actuated[a]]
        for c in range(len(passive)):
            total += W[passive[c], a] * x[passive[c]]
        out[a] = total


# Accelerations of the actuated joints under torques, without the Coriolis matrix.


@kernel
def free_acceleration(
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
    update_inertias(mechanism, workspace)
    _forces(mechanism, workspace)
    add_loads(mechanism, workspace)
    add_bias(mechanism, workspace)
    reduce_vector(mechanism, workspace, workspace.load, out)
    for j in range(len(out)):
        out[j] = torque[j] - out[j]
    _free_products(mechanism, workspace)
    add_inertia(mechanism, workspace, workspace.W, workspace.MW)
    reduce_matrix(mechanism, workspace, workspace.MW, workspace.inertia_matrix)
    solve_symmetric(workspace.inertia_matrix, out)


@internal
def _forces(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write the forces of all joints at the motion of the bodies, by Newton and Euler."""
    V, A, inertia, force = workspace.V, workspace.A, workspace.inertia, workspace.force
    parent, load, down = mechanism.parent, workspace.load, of_array(mechanism.gravity)
    for i in range(len(parent)):
        turning, moving = triple(V, i), triple(V, i, 3)
        n, f = momentum_of(inertia, i, turning, moving)
        n_rate, f_rate = momentum_of(inertia, i, triple(A, i), triple(A, i, 3) - down)
        put(force, i, 0, n_rate + (cross(turning, n) + cross(moving, f)))
        put(force, i, 3, f_rate + cross(turning, f))
    for i in range(len(parent) - 1, -1, -1):
        load[i] = power(workspace.S, i, triple(force, i), triple(force, i, 3))
        load[i] += mechanism.armature[i] * workspace.bias[i]
        j = parent[i]
        if j != BASE:
            for k in range(6):
                force[j, k] += force[i, k]


@internal
def _free_products(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write MW; bodies become composite ones."""
    S, inertia, W, MW = workspace.S, workspace.inertia, workspace.W, workspace.MW
    parent, column, n = mechanism.parent, workspace.layout.column, W.shape[1]
    clear_matrix(MW)
    for i in range(len(parent) - 1, -1, -1):
        if column[i] != LOCKED:
            n_own, f_own = momentum_of(inertia, i, triple(S, i), triple(S, i, 3))
            j = i
            while j != BASE:
                if column[j] != LOCKED:
                    m_ij = power(S, j, n_own, f_own)
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


# Motions of all bodies over many samples, for equations that are set up outside kernels.


class BodyMotions(NamedTuple):
    """Motions of N bodies at K samples; spatial vectors are angular, then linear at the origin."""

    fault: Index  # FOUND or a fault of each sample, shape (K,)
    rotation: Array  # frames of the bodies in the world, shape (K, N, 3, 3)
    origin: Array  # their origins [m], shape (K, N, 3)
    S: Array  # motion by each joint in the world, shape (K, N, 6)
    W: Array  # rates of all joints by those of the actuated ones, shape (K, N, n)
    V: Array  # velocities of the bodies, shape (K, N, 6)
    A: Array  # their accelerations, shape (K, N, 6)
    joint: Array  # accelerations of the joints, shape (K, N)


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
