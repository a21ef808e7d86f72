"""How far a machine is from its singularities, and from its ends of travel."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, kernel
from parallel_robot_model.mechanisms.closure_solver import restore
from parallel_robot_model.mechanisms.mechanism import FOUND, Index, Mechanism
from parallel_robot_model.mechanisms.pose_solving import solve_pose
from parallel_robot_model.mechanisms.spatial import clear, clear_matrix, copy, copy_matrix, nothing
from parallel_robot_model.mechanisms.tool import (
    rotation_coordinates,
    tool_jacobian,
    tool_unit,
    update_tool,
)
from parallel_robot_model.mechanisms.workspace import Workspace

# The smallest singular value of a small matrix, from the eigenvalues of its Gram matrix.

ITERATIONS = 20  # four are usual
ENOUGH = 1e-3  # relative step, the cube of which is the error that is left


@internal
def conditioning(gram: Array, tridiagonal: Array) -> float:
    """The smallest singular value over the root mean square of all: 1 if they are equal.

    Args:
        gram: A^T A, shape (k, k), of which the lower triangle is read, and overwritten.
        tridiagonal: Room for four vectors, shape (4, k) or larger.

    Returns:
        A number from 0 to 1, with an error of some 1e-8.
    """
    k, total = len(gram), trace(gram)
    if not total > 0.0:
        return 0.0
    _make_tridiagonal(gram, tridiagonal)
    smallest = _smallest_eigenvalue(tridiagonal, k, 1e-16 * total)
    return math.sqrt(min(1.0, max(0.0, k * smallest / total)))


@internal
def is_conditioned(gram: Array, share: float) -> bool:
    """Whether `evenness` is at least a share above 0, in a third of its time.

    It is if A^T A, less a multiple of the identity, has only positive pivots.

    Args:
        gram: A^T A, shape (k, k), of which the lower triangle is read, and overwritten.
        share: The share; where it is 0 or less, only numbers are asked for.
    """
    k, total = len(gram), trace(gram)
    if share <= 0.0:
        return total >= 0.0
    less = share * share * total / k
    for c in range(k - 1, -1, -1):
        pivot = gram[c, c] - less
        if not pivot > 0.0:
            return False
        for i in range(c):
            if gram[c, i] != 0.0:
                f = gram[c, i] / pivot
                for j in range(i + 1):
                    gram[i, j] -= f * gram[c, j]
    return True


@internal
def trace(a: Array) -> float:
    """Sum of the elements of the diagonal."""
    total = 0.0
    for i in range(len(a)):
        total += a[i, i]
    return total


@internal
def _make_tridiagonal(a: Array, out: Array) -> None:
    """Householder's reflections: the diagonal to row 0, squares of that beside it to row 1.

    Source:
        Golub, Van Loan (2013), Matrix Computations, algorithm 8.3.1.
    """
    n, u, p = len(a), out[2], out[3]
    for c in range(n - 1):
        square = 0.0
        for i in range(c + 2, n):
            square += a[i, c] * a[i, c]
        first = a[c + 1, c]
        whole = square + first * first
        out[0, c], out[1, c] = a[c, c], whole
        if square == 0.0:
            continue
        for i in range(c + 1, n):
            u[i], p[i] = a[i, c], 0.0
        u[c + 1] = first + math.copysign(math.sqrt(whole), first)
        b = 2.0 / (square + u[c + 1] * u[c + 1])
        along = _times_lower(a, u, p, c + 1)
        for i in range(c + 1, n):
            p[i] = b * (p[i] - 0.5 * b * along * u[i])
        for i in range(c + 1, n):
            s, t = u[i], p[i]
            for k in range(c + 1, i + 1):
                a[i, k] -= s * p[k] + t * u[k]
    out[0, n - 1] = a[n - 1, n - 1]


@internal
def _times_lower(a: Array, u: Array, p: Array, start: int) -> float:
    """Add the symmetric matrix times u to p, both from an index on."""
    along = 0.0
    for i in range(start, len(a)):
        total, own = 0.0, u[i]
        for k in range(start, i):
            total += a[i, k] * u[k]
            p[k] += a[i, k] * own
        p[i] += total + a[i, i] * own
        along += own * (2.0 * total + a[i, i] * own)
    return along


@internal
def _smallest_eigenvalue(tridiagonal: Array, n: int, noise: float) -> float:
    """Smallest eigenvalue of a positive matrix: Laguerre's iteration from zero, from below.

    Source:
        Li, Zeng (1994), The Laguerre iteration in solving the symmetric tridiagonal eigenproblem,
        revisited, SIAM J. Sci. Comput. 15(5).
    """
    x = 0.0
    for _ in range(ITERATIONS):
        # pivots q of the factored matrix, u = -q' and v = u': sums of 1 / (eigenvalue - x)
        q, u, v = 1.0, 0.0, 0.0
        first, second = 0.0, 0.0
        for i in range(n):
            over = tridiagonal[1, i - 1] / q if i > 0 else 0.0
            ratio = u / q
            v = over * (2.0 * ratio * ratio + v / q)
            u = 1.0 + over * ratio
            q = tridiagonal[0, i] - x - over
            if not q > noise:
                return x
            part = u / q
            first += part
            second += part * part + v / q
        spread = max(0.0, (n - 1) * (n * second - first * first))
        step = n / (first + math.sqrt(spread))
        x += step
        if not step > ENOUGH * x:
            return x
    return x


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
        closed = conditioning(workspace.closure_gram, workspace.tridiagonal)
    if len(mechanism.coordinate) > 0:
        _of_tool(mechanism, workspace)
        free = conditioning(workspace.tool_gram, workspace.tridiagonal)
    return closed, free


@internal
def travel_left(mechanism: Mechanism, workspace: Workspace, travel: Array, q: Array) -> float:
    """Smallest distance to an end of travel [rad or m], passive joints and tendons included.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace, at the closed posture.
        travel: Lower and upper ends of the actuated joints [rad or m], shape (2, n).
        q: Their positions [rad or m], shape (n,).
    """
    left = passive_travel_left(mechanism, workspace)
    for j in range(len(q)):
        left = min(left, q[j] - travel[0, j], travel[1, j] - q[j])
    return left


@internal
def passive_travel_left(mechanism: Mechanism, workspace: Workspace) -> float:
    """Smallest distance to an end of the lengths of its elements, infinite where there is none."""
    elements, left = mechanism.elements, np.inf
    for k in range(len(elements.ratio)):
        if elements.travel[k, 0] > -np.inf or elements.travel[k, 1] < np.inf:
            length = 0.0
            for j in range(len(workspace.all)):
                length += elements.ratio[k, j] * workspace.all[j]
            left = min(left, length - elements.travel[k, 0], elements.travel[k, 1] - length)
    return left


@kernel
def margins_hold(
    mechanism: Mechanism, workspace: Workspace, closed: float, free: float
) -> tuple[bool, bool]:
    """Whether each of the :func:`margins` is at least a number, from 0 to 1, in less time."""
    closes, moves = closed <= 1.0, free <= 1.0
    if len(workspace.error) > 0:
        closes = _closes(workspace, closed)
    if len(mechanism.coordinate) > 0:
        _of_tool(mechanism, workspace)
        moves = is_conditioned(workspace.tool_gram, free)
    return closes, moves


@internal
def _closes(workspace: Workspace, closed: float) -> bool:
    """Whether the margin of the closures is at least a number.

    A posture with twice that answers for those near it: no singular value differs by more than
    the matrices do (Weyl 1912).
    """
    bounds, block, root = (
        workspace.proven_bounds,
        workspace.proven_block,
        math.sqrt(len(workspace.error)),
    )
    distance = _distance(workspace.jacobian, block, workspace.tridiagonal[0])
    if closed > 0.0 and bounds[0] - distance >= closed * (bounds[1] + distance) / root:
        return True
    _of_closures(workspace)
    size = math.sqrt(trace(workspace.closure_gram))
    if closed > 0.0 and is_conditioned(workspace.closure_gram, 2.0 * closed):
        copy_matrix(workspace.jacobian, block)
        bounds[0], bounds[1] = 2.0 * closed * size / root, size
        return True
    _of_closures(workspace)
    return is_conditioned(workspace.closure_gram, closed)


@internal
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


@internal
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


@internal
def _of_tool(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write products of the columns of the tool's Jacobian, in units of tool and joints."""
    update_tool(mechanism, workspace)
    tool_jacobian(mechanism, workspace, rotation_coordinates(mechanism, workspace, nothing()))
    n, a, gram = len(workspace.q), workspace.tool_jacobian, workspace.tool_gram
    scale, actuated = workspace.layout.scale, mechanism.actuated
    for i in range(n):
        for k in range(i + 1):
            total = 0.0
            for row in range(len(a)):
                unit = tool_unit(mechanism, row)
                total += unit * a[row, i] * unit * a[row, k]
            gram[i, k] = scale[actuated[i]] * total * scale[actuated[k]]


# Which poses of a grid the tool reaches from one of them, without a change of its modes.

NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # row and column from a pose to the next


@kernel
def flood_fill(
    mechanism: Mechanism,
    workspace: Workspace,
    poses: Array,
    travel: Array,
    first: tuple[int, int],
    posture: Array,
    results: Array,
    queue: Index,
) -> int:
    """Flood fill: go from pose to neighbouring pose while no joint is beyond its travel.

    Every posture is continued from that of a neighbour, along the shortest way of poses. Poses
    beyond an end of travel are written, too, where a neighbour is within it, but lead nowhere.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace, near the first pose and in the modes that are asked for.
        poses: Poses [m, rad], shape (rows, columns, m).
        travel: Lower and upper ends of the actuated joints [rad or m], shape (2, n).
        first: Row and column of the pose where it begins.
        posture: Room for all joints and the angle of the tool, shape (rows, columns, N + 1).
        results: Margins of closures and tool, and travel left [rad or m], shape (rows, columns,
            3); NaN before, and where no way leads.
        queue: Room for as many indices as there are poses, shape (rows * columns,).

    Returns:
        FOUND, or the fault at the first pose.
    """
    rows, columns, length = poses.shape[0], poses.shape[1], len(workspace.all)
    row, column = first
    fault = solve_pose(mechanism, workspace, poses[row, column])
    if fault != FOUND:
        return fault
    begin, end = 0, 0
    if _note(mechanism, workspace, travel, posture[row, column], results[row, column]):
        queue[end] = row * columns + column
        end += 1
    while begin < end:
        row, column = queue[begin] // columns, queue[begin] % columns
        begin += 1
        here = posture[row, column]
        recalled = False
        for down, right in NEIGHBOURS:
            i, k = row + down, column + right
            if i < 0 or k < 0 or i >= rows or k >= columns or results[i, k, 0] == results[i, k, 0]:
                continue
            if not recalled:
                _recall(mechanism, workspace, here[:length], here[length])
            recalled = solve_pose(mechanism, workspace, poses[i, k]) != FOUND
            if recalled:
                continue
            if _note(mechanism, workspace, travel, posture[i, k], results[i, k]):
                queue[end] = i * columns + k
                end += 1
    return FOUND


@internal
def _note(
    mechanism: Mechanism, workspace: Workspace, travel: Array, posture: Array, result: Array
) -> bool:
    """Write the posture of the memory and its margins; whether all joints are in their travel."""
    length = len(workspace.all)
    posture[length] = workspace.angle[0]
    for i in range(length):
        posture[i] = workspace.all[i]
    result[0], result[1] = margins(mechanism, workspace)
    result[2] = travel_left(mechanism, workspace, travel, workspace.q)
    return bool(result[2] >= 0.0)


@internal
def _recall(mechanism: Mechanism, workspace: Workspace, posture: Array, angle: float) -> None:
    """Let the memory be a posture of before."""
    copy(posture, workspace.all)
    for j in range(len(workspace.q)):
        workspace.q[j] = posture[mechanism.actuated[j]]
    restore(mechanism, workspace, angle)
