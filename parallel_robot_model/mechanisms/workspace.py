"""The workspace of a mechanism's kernels: their memory, and linear systems that they solve in it.

Whoever uses a mechanism has a workspace of its own. Kernels allocate nothing else. They take
mechanism and workspace as they are, or as :func:`boxed` makes them, which is faster.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, internal, kernel
from parallel_robot_model.mechanisms.mechanism import Index, Layout, Mechanism, layout
from parallel_robot_model.mechanisms.spatial import copy

# Linear systems by LU with partial pivoting, in place: the same bits on every machine.
#
# The blocks of closed chains are sparse: what is zero is left out.

WIDTH = 3  # right sides that are solved together
SMALLEST = 1e-10  # pivot, of a matrix whose elements are about 1, of one that has full rank


class Factors(NamedTuple):
    """A matrix of shape (n, n), then its LU."""

    a: Array  # the matrix; then both factors, with the reciprocals of the pivots in the diagonal
    row: Index  # row of `a` that is a row of its factors, shape (n,)
    # columns of the elements of a row that are not zero: those right of the diagonal, and
    # from the end those left of it, shape (n, n)
    filled: Index
    left: Index  # number of those left of the diagonal, shape (n,)
    right: Index  # number of those right of it, shape (n,)
    busy: Index  # rows with an element in a column, in any order, shape (n,)
    room: Array  # right sides in the order of the factors, shape (n, WIDTH)


def factors(n: int) -> Factors:
    """Room for the factors of a matrix of shape (n, n)."""
    row, left, count, busy = np.zeros((4, n), np.int64)
    return Factors(
        np.zeros((n, n)), row, np.zeros((n, n), np.int64), left, count, busy, np.zeros((n, WIDTH))
    )


@internal
def factor(system: Factors) -> int:
    """Replace the matrix by its LU; rows stay where they are.

    Returns:
        Sign of the determinant, 0 if a pivot is too small or not a number.
    """
    a, row, filled, left, right = system.a, system.row, system.filled, system.left, system.right
    busy = system.busy
    n, sign = len(a), 1
    for i in range(n):
        row[i] = i
        left[i] = 0
    for c in range(n):
        p, best, rows = c, 0.0, 0
        for i in range(c, n):
            if a[row[i], c] != 0.0:
                busy[rows] = row[i]
                rows += 1
                size = abs(a[row[i], c])
                if size > best:
                    best, p = size, i
        if not best > SMALLEST:
            return 0
        pivot = row[p]
        if p != c:
            sign = -sign
            row[c], row[p] = pivot, row[c]
        if a[pivot, c] < 0.0:
            sign = -sign
        inverse = 1.0 / a[pivot, c]
        a[pivot, c] = inverse
        count = 0
        for k in range(c + 1, n):
            filled[pivot, count] = k
            count += a[pivot, k] != 0.0
        right[pivot] = count
        for i in range(rows):
            r = busy[i]
            if r != pivot:
                f = a[r, c] * inverse
                a[r, c] = f
                left[r] += 1
                filled[r, n - left[r]] = c
                for k in range(c + 1, n):
                    a[r, k] -= f * a[pivot, k]
    return sign


@internal
def solve_vector(system: Factors, b: Array) -> None:
    """Replace a right side, shape (n,), by the solution."""
    a, row, filled, left, right, _, x = system
    n = len(b)
    for i in range(n):
        r = row[i]
        total = b[r]
        for k in range(n - left[r], n):
            total -= a[r, filled[r, k]] * x[filled[r, k], 0]
        x[i, 0] = total
    for i in range(n - 1, -1, -1):
        r = row[i]
        total = x[i, 0]
        for k in range(right[r]):
            total -= a[r, filled[r, k]] * b[filled[r, k]]
        b[i] = total * a[r, i]


@internal
def solve_columns(system: Factors, b: Array) -> None:
    """Replace right sides, shape (n, k), by the solutions; k is a multiple of WIDTH."""
    a, row, filled, left, right, _, x = system
    n = len(a)
    for j in range(0, b.shape[1], WIDTH):
        for i in range(n):
            r = row[i]
            s, t, u = b[r, j], b[r, j + 1], b[r, j + 2]
            for k in range(n - left[r], n):
                c = filled[r, k]
                f = a[r, c]
                s, t, u = s - f * x[c, 0], t - f * x[c, 1], u - f * x[c, 2]
            x[i, 0], x[i, 1], x[i, 2] = s, t, u
        for i in range(n - 1, -1, -1):
            r = row[i]
            s, t, u = x[i, 0], x[i, 1], x[i, 2]
            for k in range(right[r]):
                c = filled[r, k]
                f = a[r, c]
                s, t, u = s - f * b[c, j], t - f * b[c, j + 1], u - f * b[c, j + 2]
            b[i, j], b[i, j + 1], b[i, j + 2] = s * a[r, i], t * a[r, i], u * a[r, i]


# Symmetric, positive definite systems, in place.


@internal
def solve_symmetric(a: Array, b: Array) -> None:
    """Replace b, shape (n,), by the solution of a x = b; a, shape (n, n), becomes its L D L^T.

    Only the lower triangle of `a` is read.
    """
    n = len(b)
    for i in range(n):
        for j in range(i):
            part = a[i, j]
            for k in range(j):
                part -= a[i, k] * a[j, k] * a[k, k]
            a[i, j] = part / a[j, j]
        for k in range(i):
            a[i, i] -= a[i, k] * a[i, k] * a[k, k]
            b[i] -= a[i, k] * b[k]
    for i in range(n - 1, -1, -1):
        b[i] /= a[i, i]
        for j in range(i + 1, n):
            b[i] -= a[j, i] * b[j]


FRAMES_SET, SIGN, TOOL_SIGN = range(3)  # what `state` holds


class Workspace(NamedTuple):
    """Arrays for a mechanism of N joints, r closures, n actuated joints, m coordinates.

    After each kernel, frames and Jacobians are those of the memory.
    """

    q: Array  # memory: actuated positions of the last closed posture, shape (n,)
    all: Array  # memory: positions of all its joints, shape (N,)
    pose: Array  # memory: the pose that was solved last, shape (m,)
    angle: Array  # memory: the only rotation coordinate of the pose, beyond pi, too, shape (1,)
    # memory: whether the frames are placed, the signs of the determinants of passive block
    # and of the tool's Jacobian, shape (3,)
    state: Index
    layout: Layout  # what follows from the mechanism once and for all
    trial: Array  # positions at which the frames are, shape (N,)
    here: Array  # positions of the last closed posture on a way, shape (N,)
    way: Array  # first and half the second derivative of all joints by the way, shape (2, N)
    rotation: Array  # frames of the joints in the world, shape (N, 3, 3)
    origin: Array  # their origins [m], shape (N, 3)
    S: Array  # motion by a joint: angular, and linear at the world's origin, shape (N, 6)
    error: Array  # how far the closures are open, as numbers, shape (r,)
    jacobian: Array  # derivative of `error` by passive and actuated joints, shape (r, r + n)
    factors: Factors  # LU of its passive block
    W: Array  # rates of all joints by those of the actuated ones, shape (N, n)
    W_rate: Array  # its derivative, shape (N, n)
    rate: Array  # rates of all joints, shape (N,)
    bias: Array  # their accelerations at no acceleration of the actuated ones, shape (N,)
    V: Array  # motions of the bodies, shape (N, 6)
    S_rate: Array  # derivative of `S`, shape (N, 6)
    A: Array  # accelerations of the bodies, shape (N, 6)
    force: Array  # forces on the bodies, shape (N, 6)
    inertia: Array  # mass, first moments and second moments of composite bodies, shape (N, 10)
    # half the rate of the second moments, angular and linear momentum of composite bodies,
    # shape (N, 12)
    momentum: Array
    MW: Array  # inertia matrix of all joints times `W`, shape (N, n)
    # their Coriolis matrix times `W` and their inertia matrix times `W_rate`, shape (N, n)
    QW: Array
    load: Array  # forces of all joints, shape (N,)
    right: Array  # right sides of linear systems, shape (r, n) and columns of no use
    single: Array  # one right side, shape (r,)
    inertia_matrix: Array  # that of the actuated joints, shape (n, n)
    tool_jacobian: Array  # rate of the pose by the actuated joints, shape (m, n)
    tool_factors: Factors  # LU of it
    # frame of the tool in the world, where a way begins, and where it leads, shape (3, 3, 3)
    tool_frame: Array
    tool_point: Array  # tool in the world, shape (3,)
    tool_bias: Array  # acceleration of the pose at none of the actuated joints, shape (m,)
    tool_way: Array  # pose where a way begins, and the whole way, shape (2, m)
    tool_error: Array  # distance from a pose, shape (n,)
    # what the singular values of `known_block` are at least; the root of the sum of their
    # squares, shape (2,)
    proven_bounds: Array
    proven_block: Array  # passive block of a posture with room around it, shape (r, r)
    closure_gram: Array  # products of the columns of the passive block, shape (r, r)
    tool_gram: Array  # products of the columns of the tool's Jacobian, shape (n, n)
    tridiagonal: Array  # a matrix by its diagonals, and room, shape (4, max(r, n))


def coordinates(mechanism: Mechanism) -> int:
    """Number of the coordinates of its pose, m."""
    return len(mechanism.coordinate) or len(mechanism.actuated)


def workspace(mechanism: Mechanism) -> Workspace:
    """Make a workspace, at home.

    Raises:
        RobotError: the mechanism has not as many closures as passive joints, or not as many
            coordinates of its tool as actuated joints.
    """
    N, n, r = len(mechanism.parent), len(mechanism.actuated), len(mechanism.passive)
    m = coordinates(mechanism)
    if len(mechanism.closure) != r:
        raise RobotError(f'{len(mechanism.closure)} closures for {r} passive joints, not as many')
    if m != n:
        raise RobotError(f'{m} coordinates of the tool for {n} actuated joints, not as many')
    shapes = {
        **dict.fromkeys(('trial', 'here', 'rate', 'bias', 'load'), (N,)),
        **dict.fromkeys(('S', 'V', 'S_rate', 'A', 'force'), (N, 6)),
        **dict.fromkeys(('W', 'W_rate', 'MW', 'QW'), (N, n)),
        **{'angle': (1,), 'pose': (m,), 'way': (2, N), 'rotation': (N, 3, 3), 'origin': (N, 3)},
        **{'error': (r,), 'jacobian': (r, r + n), 'right': (r, -(-n // WIDTH) * WIDTH)},
        **{'single': (r,), 'inertia': (N, 10), 'momentum': (N, 12), 'inertia_matrix': (n, n)},
        **{'tool_jacobian': (m, n), 'tool_frame': (3, 3, 3)},
        **{'tool_point': (3,), 'tool_bias': (m,), 'tool_way': (2, m), 'tool_error': (n,)},
        **{'proven_bounds': (2,), 'proven_block': (r, r), 'closure_gram': (r, r)},
        **{'tool_gram': (n, n), 'tridiagonal': (4, max(r, n))},
    }
    made = Workspace(
        q=mechanism.home[mechanism.actuated],
        all=mechanism.home.copy(),
        state=np.zeros(3, np.int64),
        layout=layout(mechanism),
        factors=factors(r),
        tool_factors=factors(n),
        **{name: np.zeros(shape) for name, shape in shapes.items()},
    )
    made.W[mechanism.actuated, np.arange(n)] = 1.0
    return made


def boxed(mechanism: Mechanism) -> tuple[Any, Any]:
    """Mechanism and a new workspace, as kernels take them without delay: by their addresses."""
    return Boxed(mechanism), Boxed(workspace(mechanism))


@kernel
def reset_to_home(mechanism: Mechanism, workspace: Workspace) -> None:
    """Begin anew at home."""
    copy(mechanism.home, workspace.all)
    for j in range(len(workspace.q)):
        workspace.q[j] = mechanism.home[mechanism.actuated[j]]
    workspace.angle[0] = 0.0
    workspace.state[FRAMES_SET] = 0
