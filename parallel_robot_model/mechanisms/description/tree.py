"""A tree of hinges and slides made of bodies and joints, and where it is at a posture.

Run a few times when a description is read: plain NumPy, no kernels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.parts import (
    WORLD,
    Description,
    Frame,
    Joint,
    chain,
    independent,
    listed,
    null_space,
    rank,
)
from parallel_robot_model.mechanisms.joint_kinds import HINGE, JointKind
from parallel_robot_model.mechanisms.mechanism import BASE

AXES = 'xyz'

Posture = Mapping[str, float | tuple[float, ...]]  # joint to position, of a ball a quaternion


class Link(NamedTuple):
    """What one hinge or slide of the tree moves."""

    name: str  # of the joint; of a ball with the axis, e.g. ``ball.x``
    joint: Joint  # the joint of the description
    body: int  # index of its body in the description
    parent: int  # index of the link before, or BASE
    kind: JointKind  # of one freedom
    rotation: Array  # frame at position zero, seen from the parent's, shape (3, 3)
    origin: Array  # its origin in the frame of the parent [m], shape (3,)
    axis: Array  # unit vector in its frame, shape (3,)
    spins: int = 0  # LAST or FIRST: of a ball whose rod spins freely about that hinge


class Tree(NamedTuple):
    """Links, and where the bodies of the description are on them."""

    links: tuple[Link, ...]  # each after its parent
    # by body: the frame of the link that carries it, whose `body` is the index of the link,
    # or BASE
    hosts: tuple[Frame, ...]

    def on_link(self, frame: Frame) -> Frame:
        """A frame on a body as one on its link."""
        return frame if frame.body == WORLD else compose(self.hosts[frame.body], frame)

    def path(self, link: int) -> list[int]:
        """The links from one to the base."""
        return chain([each.parent for each in self.links], link)


class LinkFrames(NamedTuple):
    """Where the links of a tree are."""

    rotation: Array  # frames in the world, shape (N, 3, 3)
    position: Array  # their origins [m], shape (N, 3)
    axis: Array  # axes in the world, shape (N, 3)
    path: Array  # whether link j moves link i, shape (N, N)
    turns: Array  # rad about the axes by unit of position, shape (N,)
    slides: Array  # m along them likewise, shape (N,)

    def frame(self, frame: Frame) -> tuple[Array, Array]:
        """Rotation, shape (3, 3), and origin [m], shape (3,), of a frame of a link."""
        if frame.body == BASE:
            return frame.rotation, frame.position
        rotation = self.rotation[frame.body]
        return rotation @ frame.rotation, self.position[frame.body] + rotation @ frame.position

    def rates(self, frame: Frame) -> tuple[Array, Array]:
        """Rate of the origin of a frame of a link and its angular rate by joint, (3, N) each."""
        if frame.body == BASE:
            return np.zeros((3, len(self.axis))), np.zeros((3, len(self.axis)))
        moves = self.path[frame.body][:, None]
        arm = self.frame(frame)[1] - self.position
        turns, slides = self.turns[:, None], self.slides[:, None]
        rate = (turns * np.cross(self.axis, arm) + slides * self.axis) * moves
        return rate.T, (turns * self.axis).T * moves.T


def compose(first: Frame, second: Frame) -> Frame:
    """A frame that is known from another one, seen from what the other is seen from."""
    return Frame(
        first.body,
        first.rotation @ second.rotation,
        first.position + first.rotation @ second.position,
    )


def rotation_about(axis: Array, angle: float) -> Array:
    """Rotation about an axis, shape (3, 3); exactly none for an angle of zero."""
    return Rotation.from_rotvec(axis * angle).as_matrix() if angle else np.eye(3)


def build(description: Description, posture: Posture) -> Tree:
    """The tree of a description.

    Args:
        description: Its bodies and joints.
        posture: Balls turn from here: all three hinges of one are zero at its quaternion.
    """
    links: list[Link] = []
    hosts: list[Frame] = []
    joints = description.joints
    for i, body in enumerate(description.bodies):
        frame = Frame(body.parent, body.rotation, body.position)
        frame = frame if body.parent == WORLD else compose(hosts[body.parent], frame)
        for joint in (joint for joint in joints if joint.body == i):
            frame = _add(links, i, joint, frame, posture.get(joint.name))
        hosts.append(frame)
    return Tree(tuple(links), tuple(hosts))


def _add(links: list[Link], body: int, joint: Joint, frame: Frame, value: object) -> Frame:
    """Append the links of a joint that moves a frame; return the frame on the last of them."""
    at = compose(frame, Frame(WORLD, position=joint.anchor))
    rotation, origin = at.rotation, at.position
    if joint.kind.single:
        origin = origin - rotation @ joint.axis * (joint.kind.slides * joint.zero)
        rotation = rotation @ rotation_about(joint.axis, -joint.kind.turns * joint.zero)
        steps = [(joint.name, joint.kind, joint.axis)]
    else:
        if isinstance(value, tuple):
            rotation = rotation @ Rotation.from_quat(value, scalar_first=True).as_matrix()
        steps = [(f'{joint.name}.{AXES[i]}', HINGE, np.eye(3)[i]) for i in range(3)]
    parent = frame.body
    for name, kind, axis in steps:
        links.append(Link(name, joint, body, parent, kind, rotation, origin, axis))
        parent, rotation, origin = len(links) - 1, np.eye(3), np.zeros(3)
    return Frame(parent, position=-joint.anchor)


def link_frames(tree: Tree, q: Array) -> LinkFrames:
    """Where the links are at positions [rad or m], shape (N,)."""
    count = len(tree.links)
    rotation, position = np.zeros((count, 3, 3)), np.zeros((count, 3))
    path = np.zeros((count, count), dtype=bool)
    for i, link in enumerate(tree.links):
        before, origin = (np.eye(3), np.zeros(3))
        if link.parent != BASE:
            before, origin = rotation[link.parent], position[link.parent]
            path[i] = path[link.parent]
        path[i, i] = True
        rotation[i] = before @ link.rotation
        position[i] = origin + before @ link.origin
        position[i] += rotation[i] @ link.axis * (link.kind.slides * q[i])
        rotation[i] = rotation[i] @ rotation_about(link.axis, link.kind.turns * q[i])
    axis = np.array([rotation[i] @ link.axis for i, link in enumerate(tree.links)])
    turns, slides = (
        np.array([getattr(link.kind, each) for link in tree.links], np.float64)
        for each in ('turns', 'slides')
    )
    return LinkFrames(rotation, position, axis.reshape(-1, 3), path, turns, slides)


# Who drives a machine, who follows by its loops, and who is held.

MOVED = 1e-5  # rate of the tool, relative to that of a joint, that counts as none


class Freedoms(NamedTuple):
    """The parts of the joints."""

    actuated: list[int]  # indices of the joints that are driven, in the order that was asked for
    passive: list[int]  # those that follow by the closures, ascending
    # those that were to be held, and those that nothing moves and that do not move the tool,
    # ascending
    held: list[int]
    rows: list[int]  # as many closures as passive joints, independent of each other, ascending


def divide(
    source: str,
    names: Sequence[str],
    closures: Array,
    tool: Array,
    actuated: list[int],
    held: list[int],
) -> Freedoms:
    """Divide the joints by what the closures leave free.

    Args:
        source: What the machine is called in messages.
        names: Of the N joints.
        closures: Derivative of the R closures by the joints, in one unit, shape (R, N).
        tool: Motion of the tool by the joints, in the same unit, shape (6, N).
        actuated: Joints that are driven.
        held: Joints that are to be held.

    Raises:
        InputError: there are more or fewer actuated joints than freedoms.
    """
    passive = [i for i in range(len(names)) if i not in {*actuated, *held}]
    free = [*actuated, *passive]
    own = closures[:, passive]
    follow, whole = rank(own), rank(closures[:, free])
    freedoms = len(free) - whole
    if follow < whole:
        surplus = [i for i in actuated if rank(closures[:, [*passive, i]]) > follow]
        raise InputError(
            f'{source}: {_many(len(actuated), "actuated joint")}, but the loops leave '
            f'{len(actuated) - whole + follow} of them free; drop '
            f'{whole - follow} of {listed(names[i] for i in surplus)}'
        )
    null = null_space(own)
    driftings = rank(_significant(tool[:, passive] @ null))
    if driftings:
        moved = tool[:, passive] @ null
        missing = [
            joint
            for i, joint in enumerate(passive)
            if rank(_significant(moved @ null_space(null[[i]]))) < driftings
        ]
        missing.sort(key=lambda i: '.' in names[i])  # parts of balls last
        raise InputError(
            f'{source}: {_many(freedoms, "freedom")}, but {len(actuated)} actuated: the tool '
            f'moves while they stand still; actuate {driftings} more, or hold them, of '
            f'{listed(names[i] for i in missing)}'
        )
    idle = [passive[i] for i in independent(null, null.shape[1])]
    passive = [i for i in passive if i not in idle]
    rows = independent(closures[:, passive], follow)
    return Freedoms(actuated, passive, sorted([*held, *idle]), rows)


def joint_map(closures: Array, freedoms: Freedoms) -> Array:
    """Motion of all N joints by that of the n actuated ones, shape (N, n)."""
    motion = np.zeros((closures.shape[1], len(freedoms.actuated)))
    motion[freedoms.actuated] = np.eye(len(freedoms.actuated))
    if freedoms.passive:
        rows = closures[freedoms.rows]
        motion[freedoms.passive] = -np.linalg.solve(
            rows[:, freedoms.passive], rows[:, freedoms.actuated]
        )
    return motion


def _significant(matrix: Array) -> Array:
    return np.where(np.abs(matrix) > MOVED, matrix, 0.0)


def _many(count: int, what: str) -> str:
    return f'{count} {what}' + 's' * (count != 1)
