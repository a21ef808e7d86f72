"""What a description says of a robot: bodies, joints, what closes loops, actuators, frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array

WORLD = -1  # in place of a body: what does not move
HINGE, SLIDE, BALL = 'hinge', 'slide', 'ball'
INFINITY = float('inf')


class Body(NamedTuple):
    """A rigid body, after its parent in the list of bodies.

    Attributes:
        name: Its name, unique.
        parent: Index of the body that carries it, or WORLD.
        rotation: Its frame where all its joints are at their zero, seen from the parent's, shape
            (3, 3).
        position: Its origin there, in the frame of the parent [m], shape (3,).
        mass: Mass [kg].
        centre: Centre of mass in its frame [m], shape (3,).
        inertia: About the centre of mass in its frame [kg m^2], shape (3, 3).
    """

    name: str
    parent: int
    rotation: Array
    position: Array
    mass: float = 0.0
    centre: Array = np.zeros(3)
    inertia: Array = np.zeros((3, 3))


class Joint(NamedTuple):
    """A joint between a body and its parent; those of one body act one after the other.

    Attributes:
        name: Its name, unique.
        body: Index of the body that it moves.
        kind: HINGE, SLIDE or BALL.
        axis: A unit vector in the frame of the body, shape (3,).
        anchor: A point on the axis in that frame [m], shape (3,).
        zero: Its position where the frames of the bodies were read [rad or m].
        lower: Least position [rad or m].
        upper: Greatest position [rad or m].
        effort: Greatest torque or force [N m or N].
        velocity: Greatest rate [rad/s or m/s].
        viscous: Viscous friction [N m s/rad or N s/m].
        coulomb: Dry friction [N m or N].
        armature: Inertia of the rotor, as felt at the joint [kg m^2 or kg].
    """

    name: str
    body: int
    kind: str
    axis: Array
    anchor: Array = np.zeros(3)
    zero: float = 0.0
    lower: float = -INFINITY
    upper: float = INFINITY
    effort: float = INFINITY
    velocity: float = INFINITY
    viscous: float = 0.0
    coulomb: float = 0.0
    armature: float = 0.0


class Frame(NamedTuple):
    """A frame on a body, or in the world.

    Attributes:
        body: Index of the body, or WORLD.
        rotation: Shape (3, 3), seen from the body.
        position: Its origin in the frame of the body [m], shape (3,).
    """

    body: int
    rotation: Array = np.eye(3)
    position: Array = np.zeros(3)


class Loop(NamedTuple):
    """Two frames that coincide.

    Attributes:
        name: What the file calls it.
        first: One frame.
        second: The other.
        turns: Whether their rotations coincide as well as their origins.
    """

    name: str
    first: Frame
    second: Frame
    turns: bool


class Coupling(NamedTuple):
    """A joint that follows another: position = offset + ratio * position of the other.

    Attributes:
        name: What the file calls it.
        joint: The joint that follows.
        other: The other; empty: the joint does not move.
        ratio: Ratio of their motions.
        offset: Position where the other is at zero [rad or m].
    """

    name: str
    joint: str
    other: str
    ratio: float = 1.0
    offset: float = 0.0


class Actuator(NamedTuple):
    """What drives a joint.

    Attributes:
        name: What the file calls it.
        joint: The joint that it drives.
        effort: Greatest torque or force at the joint [N m or N].
    """

    name: str
    joint: str
    effort: float = INFINITY


class Description(NamedTuple):
    """A robot as its file describes it.

    Attributes:
        source: What the file is called in messages.
        bodies: Each after its parent.
        joints: In the order of their bodies.
        loops: Frames that coincide.
        couplings: Joints that follow others.
        actuators: What drives joints.
        frames: Frames by name: sites, links, bodies.
        keyframes: Postures by name: joint to position, of a ball a quaternion (w, x, y, z).
        gravity: Acceleration of gravity [m/s^2], shape (3,).
        doubts: What was read in a way that its author may not expect.
    """

    source: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    loops: tuple[Loop, ...]
    couplings: tuple[Coupling, ...]
    actuators: tuple[Actuator, ...]
    frames: dict[str, Frame]
    keyframes: dict[str, dict[str, float | tuple[float, ...]]]
    gravity: Array
    doubts: tuple[str, ...]


# Names of parts of a robot in messages.

FEW = 8  # names that a message lists


def listed(names: Iterable[str]) -> str:
    """The first names, and how many more there are."""
    found = list(names)
    more = f' and {len(found) - FEW} more' if len(found) > FEW else ''
    return ', '.join(map(printable, found[:FEW])) + more


# Numbers of a description that no machine has.

LARGEST_NUMBER = 1e9  # kg, m, kg m^2 and so on


def check_bounds(description: Description) -> None:
    """Refuse numbers that are not finite, or so large that they overflow later; swapped ends.

    Raises:
        InputError: there is one.
    """
    for name, value in _numbers(description):
        if not np.all(np.abs(np.asarray(value, dtype=float)) < LARGEST_NUMBER):
            raise InputError(
                f'{description.source}: {name} has a number that is not below {LARGEST_NUMBER:g}'
            )
    for joint in description.joints:
        if joint.lower > joint.upper:
            raise InputError(
                f'{description.source}: the travel of joint {printable(joint.name)!r} has its '
                f'ends swapped: from {joint.lower:.4g} to {joint.upper:.4g}'
            )


def _numbers(description: Description) -> Iterator[tuple[str, Any]]:
    """What parts are called, and their numbers; limits may be infinite."""
    for body in description.bodies:
        yield from ((f'body {printable(body.name)!r}', value) for value in body[2:])
    for joint in description.joints:
        own = (joint.axis, joint.anchor, joint.zero, joint.viscous, joint.coulomb, joint.armature)
        yield from ((f'joint {printable(joint.name)!r}', value) for value in own)
    for loop in description.loops:
        for frame in (loop.first, loop.second):
            yield f'loop {printable(loop.name)!r}', frame.position
    for coupling in description.couplings:
        yield f'coupling {printable(coupling.name)!r}', (coupling.ratio, coupling.offset)
    for name, frame in description.frames.items():
        yield f'frame {printable(name)!r}', frame.position
    for name, posture in description.keyframes.items():
        yield from ((f'keyframe {printable(name)!r}', value) for value in posture.values())
    yield 'gravity', description.gravity


# Independent rows of a matrix, chosen in the same way on every computer.

TOLERANCE = 1e-5  # singular values, relative to the largest, that count as zero
TIE = 1e-6  # relative difference of lengths below which the first row is taken


def rank(matrix: Array) -> int:
    """How many rows are independent of each other."""
    if not matrix.size:
        return 0
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > TOLERANCE * max(values[0], TOLERANCE)))


def null_space(matrix: Array) -> Array:
    """An orthonormal basis of what a matrix makes zero, shape (columns, k)."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    return np.asarray(np.linalg.svd(matrix)[2][rank(matrix) :].T)


def independent(matrix: Array, count: int) -> list[int]:
    """Rows by a Gram-Schmidt process with pivots: the longest of what is left comes next.

    Args:
        matrix: Its rows, of rank `count` or more.
        count: How many rows are chosen.

    Returns:
        Their indices, ascending.
    """
    left, chosen = matrix.copy(), []
    for _ in range(count):
        lengths = np.linalg.norm(left, axis=1)
        pivot = int(np.argmax(lengths >= (1.0 - TIE) * lengths.max()))
        unit = left[pivot] / lengths[pivot]
        left -= np.outer(left @ unit, unit)
        left[pivot] = 0.0
        chosen.append(pivot)
    return sorted(chosen)
