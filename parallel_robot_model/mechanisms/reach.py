"""Which poses of a grid the tool reaches from one of them, without a change of its modes."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.mechanisms.closing import go_back
from parallel_robot_model.mechanisms.margins import margins, travel_left
from parallel_robot_model.mechanisms.mechanism import FOUND, Index, Mechanism
from parallel_robot_model.mechanisms.pose_solving import solve_pose
from parallel_robot_model.mechanisms.spatial import copy
from parallel_robot_model.mechanisms.workspace import Workspace

NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # row and column from a pose to the next


@kernel
def spread(
    mechanism: Mechanism,
    workspace: Workspace,
    poses: Array,
    travel: Array,
    first: tuple[int, int],
    posture: Array,
    found: Array,
    queue: Index,
) -> int:
    """Go from pose to neighbouring pose as long as no joint is beyond its travel.

    Every posture is continued from that of a neighbour, along the shortest way of poses. Poses
    beyond an end of travel are written, too, where a neighbour is within it, but lead nowhere.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace, near the first pose and in the modes that are asked for.
        poses: Poses [m, rad], shape (rows, columns, m).
        travel: Lower and upper ends of the actuated joints [rad or m], shape (2, n).
        first: Row and column of the pose where it begins.
        posture: Room for all joints and the angle of the tool, shape (rows, columns, N + 1).
        found: Margins of closures and tool, and travel left [rad or m], shape (rows, columns, 3);
            NaN before, and where no way leads.
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
    if _note(mechanism, workspace, travel, posture[row, column], found[row, column]):
        queue[end] = row * columns + column
        end += 1
    while begin < end:
        row, column = queue[begin] // columns, queue[begin] % columns
        begin += 1
        here = posture[row, column]
        recalled = False
        for down, right in NEIGHBOURS:
            i, k = row + down, column + right
            if i < 0 or k < 0 or i >= rows or k >= columns or found[i, k, 0] == found[i, k, 0]:
                continue
            if not recalled:
                _recall(mechanism, workspace, here[:length], here[length])
            recalled = solve_pose(mechanism, workspace, poses[i, k]) != FOUND
            if recalled:
                continue
            if _note(mechanism, workspace, travel, posture[i, k], found[i, k]):
                queue[end] = i * columns + k
                end += 1
    return FOUND


@inner
def _note(
    mechanism: Mechanism, workspace: Workspace, travel: Array, posture: Array, found: Array
) -> bool:
    """Write the posture of the memory and its margins; whether all joints are in their travel."""
    length = len(workspace.all)
    posture[length] = workspace.angle[0]
    for i in range(length):
        posture[i] = workspace.all[i]
    found[0], found[1] = margins(mechanism, workspace)
    found[2] = travel_left(travel, workspace.q)
    return bool(found[2] >= 0.0)


@inner
def _recall(mechanism: Mechanism, workspace: Workspace, posture: Array, angle: float) -> None:
    """Let the memory be a posture of before."""
    copy(posture, workspace.all)
    for j in range(len(workspace.q)):
        workspace.q[j] = posture[mechanism.actuated[j]]
    go_back(mechanism, workspace, angle)
