"""A link of a robot, and the joint about which it turns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.parts import WORLD, Joint
from parallel_robot_model.mechanisms.joint_kinds import HINGE, JointKind
from parallel_robot_model.mechanisms.spatial import quaternion_product

Point = tuple[float, ...]  # x, y, and z where that is not zero [m]
Moments = tuple[float, float, float, float, float, float]
IDLE = Joint('', WORLD, HINGE, np.array([0.0, 0.0, 1.0]))  # nothing acts in it
ENDLESS = (-1e3, 1e3)  # rad or m, ends of travel that are none


class Link(NamedTuple):
    """A link and the joint that it moves with."""

    name: str  # name of the link and of its frame
    parent: str  # name of the link that carries it, or the fixed frame
    joint: str  # name of its joint
    origin: Point  # the joint in the frame of the parent [m]
    mass: float  # mass [kg]
    centre: Point  # centre of mass in its own frame [m]
    # about z through the centre of mass [kg m^2]; of a link that moves in space xx, xy, xz,
    # yy, yz, zz
    inertia: float | Moments
    # both ends of each straight line of a picture, in its own frame [m]
    lines: tuple[tuple[Point, Point], ...]
    # its frame where the joint is at zero, seen from that of the parent, a quaternion x, y, z, w
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    # axis of the joint in its own frame, a unit vector
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    kind: JointKind = HINGE  # of one freedom or none
    travel: tuple[float, float] = ENDLESS  # ends of travel [rad or m]
    acting: Joint = IDLE  # its friction, limits, rotor and spring
    follows: tuple[str, float, float] | None = None  # another joint, the ratio, the offset


class Closure(NamedTuple):
    """Two points that coincide and close a loop."""

    ends: tuple[str, str]  # names of links
    points: tuple[Point, Point]  # on each, in its frame [m]
    # of the frame of the first link seen from the second where both coincide, a quaternion
    # x, y, z, w; None: only the points do
    rotation: tuple[float, float, float, float] | None = None


class Beside(NamedTuple):
    """What a URDF says of a robot beside the links of its tree, and what it cannot say."""

    closures: tuple[Closure, ...] = ()
    links: tuple[Link, ...] = ()  # more frames
    unsaid: tuple[str, ...] = ()  # keys and values to be given along with the URDF


def in_3d(point: Point) -> tuple[float, float, float]:
    """A point with its z [m]."""
    x, y, z = (*point, 0.0)[:3]
    return x, y, z


def frames(links: Sequence[Link], positions: Array) -> tuple[Array, Array]:
    """Frames of links, each in that of its parent.

    Args:
        links: The links, L.
        positions: Of their joints [rad or m], shape (L,).

    Returns:
        Origins [m], shape (L, 3), and quaternions x, y, z, w, shape (L, 4).
    """
    origins = np.array([in_3d(link.origin) for link in links]).reshape(-1, 3)
    rotations = np.array([link.rotation for link in links]).reshape(-1, 4)
    axes = np.array([link.axis for link in links]).reshape(-1, 3)
    slides = np.array([link.kind.slides for link in links])
    half = np.array([link.kind.turns for link in links]) * positions / 2.0
    turned = np.concatenate([axes * np.sin(half)[:, np.newaxis], np.cos(half)[:, np.newaxis]], 1)
    shift = axes * (slides * positions)[:, np.newaxis]
    return origins + _rotated(rotations, shift), quaternion_product(rotations, turned)


def _rotated(quaternions: Array, vectors: Array) -> Array:
    """Vectors, shape (L, 3), turned by quaternions, shape (L, 4)."""
    u, w = quaternions[:, :3], quaternions[:, 3:]
    apart = 2.0 * np.cross(u, vectors)
    turned: Array = vectors + w * apart + np.cross(u, apart)
    return turned


# Checks of the parameters of links: lengths, masses, inertias and centres of mass.

CENTRES = (('lc1', 'l1'), ('lc2', 'l2'))  # keys: centre of mass of a link, and its length


def check_links(robot: Any, positive: Sequence[str], name: str) -> None:
    """Check a robot with a proximal and a distal link.

    Args:
        robot: Its parameters.
        positive: Keys that must be positive.
        name: Prefix of the keys in messages.

    Raises:
        RobotError: one of them is not positive, or a centre of mass lies outside its link.
    """
    for key in positive:
        if not getattr(robot, key) > 0.0:
            value, key = getattr(robot, key), f'{name}.{key}'
            raise RobotError(f'{key} must be positive, not {value:g}', key)
    for key, link in CENTRES:
        centre, length = getattr(robot, key), getattr(robot, link)
        if not 0.0 <= centre <= length:
            raise RobotError(
                f'{name}.{key} must lie on its link, from 0 to {link} = {length:g} m, '
                f'not {centre:g}',
                f'{name}.{key}',
            )
