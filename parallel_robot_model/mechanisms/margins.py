"""How far a machine is from its singularities, and from its ends of travel."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.mechanisms.singular_values import evenness, is_as_even, trace
from parallel_robot_model.mechanisms.spatial import clear, clear_matrix, copy_matrix
from parallel_robot_model.mechanisms.tool import place_tool, tool_jacobian, tool_unit, turning
from parallel_robot_model.mechanisms.workspace import Workspace


@kernel
def margins(mechanism: Mechanism, workspace: Workspace) -> tuple[float, float]:
    """Distances from singularities at the closed posture.

    Both are the smallest singular value of a Jacobian over the root mean square of all: 0 where
    it is singular, 1 where no direction is better than another. Lengths are measured in the length
    of the mechanism, so that they compare with angles.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace.

    Returns:
        That of the closures by the passive joints: at 0 the machine yields though its actuated
        joints are held (type 2); 1 without loops. That of the pose by the actuated joints: at 0
        the tool cannot move in some direction (type 1); 1 if the pose is the joints.
    """
    closed, free = 1.0, 1.0
    if len(workspace.error) > 0:
        _of_closures(workspace)
        closed = evenness(workspace.closure_gram, workspace.tridiagonal)
    if len(mechanism.coordinate) > 0:
        _of_tool(mechanism, workspace)
        free = evenness(workspace.tool_gram, workspace.tridiagonal)
    return closed, free


@inner
def travel_left(travel: Array, q: Array) -> float:
    """Smallest distance to an end of travel [rad or m], shapes (2, n) and (n,)."""
    left = np.inf
    for j in range(len(q)):
        left = min(left, q[j] - travel[0, j], travel[1, j] - q[j])
    return left


@kernel
def keeps(
    mechanism: Mechanism, workspace: Workspace, closed: float, free: float
) -> tuple[bool, bool]:
    """Whether each of the :func:`margins` is at least a number, from 0 to 1, in less time."""
    closes, moves = closed <= 1.0, free <= 1.0
    if len(workspace.error) > 0:
        closes = _closes(workspace, closed)
    if len(mechanism.coordinate) > 0:
        _of_tool(mechanism, workspace)
        moves = is_as_even(workspace.tool_gram, free)
    return closes, moves


@inner
def _closes(workspace: Workspace, closed: float) -> bool:
    """Whether the margin of the closures is at least a number.

    A posture with twice that answers for those near it: no singular value differs by more than
    the matrices do (Weyl 1912).
    """
    known, block, root = workspace.known, workspace.known_block, math.sqrt(len(workspace.error))
    apart = _distance(workspace.jacobian, block, workspace.tridiagonal[0])
    if closed > 0.0 and known[0] - apart >= closed * (known[1] + apart) / root:
        return True
    _of_closures(workspace)
    size = math.sqrt(trace(workspace.closure_gram))
    if closed > 0.0 and is_as_even(workspace.closure_gram, 2.0 * closed):
        copy_matrix(workspace.jacobian, block)
        known[0], known[1] = 2.0 * closed * size / root, size
        return True
    _of_closures(workspace)
    return is_as_even(workspace.closure_gram, closed)


@inner
def _distance(a: Array, b: Array, squares: Array) -> float:
    """Root of the sum of squares of a - b, of the shape of b; `squares` is room for a row."""
    clear(squares)
    for row in range(b.shape[0]):
        for c in range(b.shape[1]):
            apart = a[row, c] - b[row, c]
            squares[c] += apart * apart
    total = 0.0
    for c in range(b.shape[1]):
        total += squares[c]
    return math.sqrt(total)


@inner
def _of_closures(workspace: Workspace) -> None:
    """Write products of the columns of the passive block."""
    r, a, gram = len(workspace.error), workspace.jacobian, workspace.closure_gram
    clear_matrix(gram)
    for row in range(r):
        for i in range(r):
            x = a[row, i]
            if x != 0.0:
                for k in range(i + 1):
                    gram[i, k] += x * a[row, k]


@inner
def _of_tool(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write products of the columns of the tool's Jacobian, in units of tool and joints."""
    place_tool(mechanism, workspace)
    tool_jacobian(mechanism, workspace, turning(mechanism, workspace, (0.0, 0.0, 0.0)))
    n, a, gram = len(workspace.q), workspace.tool_jacobian, workspace.tool_gram
    scale, actuated = workspace.layout.scale, mechanism.actuated
    for i in range(n):
        for k in range(i + 1):
            total = 0.0
            for row in range(len(a)):
                unit = tool_unit(mechanism, row)
                total += unit * a[row, i] * unit * a[row, k]
            gram[i, k] = scale[actuated[i]] * total * scale[actuated[k]]
