"""A mechanism as lines: from joint to joint, to where loops close, and to the tool."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.mechanisms.closure_solver import close, restore
from parallel_robot_model.mechanisms.closures import update_frames
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, POINT, Index, Mechanism
from parallel_robot_model.mechanisms.spatial import copy, copy_matrix
from parallel_robot_model.mechanisms.workspace import FRAMES_SET, Workspace, boxed

# Many samples at once: postures, and frames for pictures.


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
        update_frames(mechanism, workspace)
        for i in range(rotation.shape[1]):
            copy_matrix(workspace.rotation[i], rotation[k, i])
        copy_matrix(workspace.origin, origin[k])
    if workspace.state[FRAMES_SET] != 0:
        restore(mechanism, workspace, workspace.angle[0])


SHORT = 1e-6  # of the length of the mechanism: less is no line
FLAT = 1e-3  # of the length of points: less across them is a line


class Line(NamedTuple):
    """A straight line of a link, from one of its points to another."""

    link: int  # the joint that moves it, or BASE
    ends: Array  # both points in the frame of that joint [m], shape (2, 3)
    # a slide that takes the second point along, from where it is at position zero, or BASE
    slide: int = BASE


def lines(mechanism: Mechanism) -> tuple[Line, ...]:
    """The lines of all links: from its joint to all else that it carries, or round a platform.

    Each slide ends a line: that which leads to it along its axis, or one of its way alone.
    """
    carried: defaultdict[int, list[Array]] = defaultdict(list)
    for parent, origin in zip(mechanism.parent, mechanism.origin, strict=True):
        carried[int(parent)].append(origin)
    for k in np.flatnonzero(mechanism.closure == POINT):
        carried[int(mechanism.first[k])].append(mechanism.first_point[k])
        carried[int(mechanism.second[k])].append(mechanism.second_point[k])
    carried[int(mechanism.tool)].append(mechanism.tool_point)
    slides = [
        (int(i), int(mechanism.parent[i]), mechanism.origin[i])
        for i in np.flatnonzero((mechanism.slides != 0.0) & (mechanism.parent != BASE))
    ]
    at_end = {
        (link, point.tobytes()): slide
        for slide, link, point in slides
        if _leads_along(mechanism, slide)
    }
    found: list[Line] = []
    for link in sorted(carried.keys() - {BASE}):
        points = _distinct([np.zeros(3), *carried[link]], SHORT * mechanism.length)
        tip = mechanism.tool_point if link == mechanism.tool else None
        joints = [point for point in points if point is not tip]
        corners = _outline(np.array(joints))
        if len(corners):
            edges = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            found += [Line(link, np.stack(edge)) for edge in edges]
        centre = corners.mean(axis=0) if len(corners) else points[0]
        ended = {} if len(corners) else at_end
        at = {corner.tobytes() for corner in corners}
        inside = [point for point in points if point.tobytes() not in at]
        found += [
            Line(link, np.stack([centre, point]), ended.get((link, point.tobytes()), BASE))
            for point in inside
            if np.linalg.norm(point - centre) > SHORT * mechanism.length
        ]
    led = {line.slide for line in found}
    found += [
        Line(link, np.stack([point, point]), slide)
        for slide, link, point in slides
        if slide not in led
    ]
    return tuple(found)


def _leads_along(mechanism: Mechanism, slide: int) -> bool:
    """Whether the way from the joint before a slide has the direction of its axis."""
    axis = mechanism.rotation[slide] @ mechanism.axis[slide]
    across = np.cross(axis, mechanism.origin[slide])
    return bool(np.linalg.norm(across) <= SHORT * mechanism.length)


def _distinct(points: list[Array], distance: float) -> list[Array]:
    """Points without those that are near one before."""
    distinct: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > distance for other in distinct):
            distinct.append(point)
    return distinct


def _outline(points: Array) -> Array:
    """Corners of points in the order around, shape (C, 3); none of those on a line."""
    across = points - points.mean(axis=0)
    _, spread, axes = np.linalg.svd(across)
    if len(points) < 3 or spread[1] < FLAT * spread[0]:
        return np.empty((0, 3))
    order = ConvexHull(across @ axes[:2].T).vertices
    order = np.roll(order, -int(order.argmin()))
    return points[order if order[1] < order[-1] else np.roll(order[::-1], 1)]


def positions_of(mechanism: Mechanism, q: Array) -> tuple[Array, Index]:
    """All joints at actuated ones, each posture from the one before, the first from home.

    Args:
        mechanism: The mechanism.
        q: Actuated joints [rad or m], shape (K, n).

    Returns:
        All joints, shape (K, N), NaN where there is a fault; the faults, shape (K,).
    """
    value, made = boxed(mechanism)
    given = np.ascontiguousarray(q, np.float64)
    positions = np.empty((len(given), len(mechanism.parent)))
    fault = np.zeros(len(given), np.int64)
    postures(value, made, given, positions, fault)
    return positions, fault


def drawn(mechanism: Mechanism, positions: Array) -> Array:
    """Ends of the lines of :func:`lines` in the world.

    Args:
        mechanism: The mechanism.
        positions: All joints [rad or m], shape (K, N).

    Returns:
        Shape (K, lines, 2, 3) [m].
    """
    count, joints = positions.shape
    rotation, origin = np.empty((count, joints, 3, 3)), np.empty((count, joints, 3))
    value, made = boxed(mechanism)
    frames(value, made, np.ascontiguousarray(positions), rotation, origin)
    links = lines(mechanism)
    found = np.zeros((count, len(links), 2, 3))
    for k, line in enumerate(links):
        turned = np.einsum('kab,eb->kea', rotation[:, line.link], line.ends)
        found[:, k] = turned + origin[:, line.link, np.newaxis]
        if line.slide != BASE:
            found[:, k, 1] = origin[:, line.slide]
    return found
