"""The workspace of a mechanism's kernels: their memory of the posture, and arrays to compute in.

Whoever uses a mechanism has a workspace of its own. Kernels allocate nothing else. They take
mechanism and workspace as they are, or as :func:`boxed` makes them, which is faster.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, kernel
from parallel_robot_model.mechanisms.linear_solve import WIDTH, Factors, factors
from parallel_robot_model.mechanisms.mechanism import Index, Layout, Mechanism, layout
from parallel_robot_model.mechanisms.spatial import copy

PLACED, SIGN, TOOL_SIGN = range(3)  # what `state` holds


class Workspace(NamedTuple):
    """Arrays for a mechanism of N joints, r closures, n actuated joints, m coordinates.

    After each kernel, frames and Jacobians are those of the memory.

    Attributes:
        q: Memory: actuated positions of the last closed posture, shape (n,).
        all: Memory: positions of all its joints, shape (N,).
        pose: Memory: the pose that was solved last, shape (m,).
        angle: Memory: the only rotation coordinate of the pose, beyond pi, too, shape (1,).
        state: Memory: whether the frames are placed, the signs of the determinants of passive
            block and of the tool's Jacobian, shape (3,).
        layout: What follows from the mechanism once and for all.
        trial: Positions at which the frames are, shape (N,).
        here: Positions of the last closed posture on a way, shape (N,).
        way: First and half the second derivative of all joints by the way, shape (2, N).
        rotation: Frames of the joints in the world, shape (N, 3, 3).
        origin: Their origins [m], shape (N, 3).
        S: Motion by a joint: angular, and linear at the world's origin, shape (N, 6).
        error: How far the closures are open, as numbers, shape (r,).
        jacobian: Derivative of `error` by passive and actuated joints, shape (r, r + n).
        factors: LU of its passive block.
        W: Rates of all joints by those of the actuated ones, shape (N, n).
        W_rate: Its derivative, shape (N, n).
        rate: Rates of all joints, shape (N,).
        bias: Their accelerations at no acceleration of the actuated ones, shape (N,).
        V: Motions of the bodies, shape (N, 6).
        S_rate: Derivative of `S`, shape (N, 6).
        A: Accelerations of the bodies, shape (N, 6).
        force: Forces on the bodies, shape (N, 6).
        inertia: Mass, first moments and second moments of composite bodies, shape (N, 10).
        momentum: Half the rate of the second moments, angular and linear momentum of composite
            bodies, shape (N, 12).
        MW: Inertia matrix of all joints times `W`, shape (N, n).
        QW: Their Coriolis matrix times `W` and their inertia matrix times `W_rate`, shape (N, n).
        load: Forces of all joints, shape (N,).
        right: Right sides of linear systems, shape (r, n) and columns of no use.
        single: One right side, shape (r,).
        inertia_matrix: That of the actuated joints, shape (n, n).
        tool_jacobian: Rate of the pose by the actuated joints, shape (m, n).
        tool_factors: LU of it.
        tool_frame: Frame of the tool in the world, where a way begins, and where it leads, shape
            (3, 3, 3).
        tool_point: Tool in the world, shape (3,).
        tool_bias: Acceleration of the pose at none of the actuated joints, shape (m,).
        tool_way: Pose where a way begins, and the whole way, shape (2, m).
        tool_error: Distance from a pose, shape (n,).
        known: What the singular values of `known_block` are at least; the root of the sum of their
            squares, shape (2,).
        known_block: Passive block of a posture with room around it, shape (r, r).
        closure_gram: Products of the columns of the passive block, shape (r, r).
        tool_gram: Products of the columns of the tool's Jacobian, shape (n, n).
        tridiagonal: A matrix by its diagonals, and room, shape (4, max(r, n)).
    """

    q: Array
    all: Array
    pose: Array
    angle: Array
    state: Index
    layout: Layout
    trial: Array
    here: Array
    way: Array
    rotation: Array
    origin: Array
    S: Array
    error: Array
    jacobian: Array
    factors: Factors
    W: Array
    W_rate: Array
    rate: Array
    bias: Array
    V: Array
    S_rate: Array
    A: Array
    force: Array
    inertia: Array
    momentum: Array
    MW: Array
    QW: Array
    load: Array
    right: Array
    single: Array
    inertia_matrix: Array
    tool_jacobian: Array
    tool_factors: Factors
    tool_frame: Array
    tool_point: Array
    tool_bias: Array
    tool_way: Array
    tool_error: Array
    known: Array
    known_block: Array
    closure_gram: Array
    tool_gram: Array
    tridiagonal: Array


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
        **{'known': (2,), 'known_block': (r, r), 'closure_gram': (r, r)},
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
def begin(mechanism: Mechanism, workspace: Workspace) -> None:
    """Begin anew at home."""
    copy(mechanism.home, workspace.all)
    for j in range(len(workspace.q)):
        workspace.q[j] = mechanism.home[mechanism.actuated[j]]
    workspace.angle[0] = 0.0
    workspace.state[PLACED] = 0
