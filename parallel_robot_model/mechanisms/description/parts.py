"""What a description says of a robot: bodies, joints, what closes loops, actuators, frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.joint_kinds import JointKind

WORLD = -1  # in place of a body: what does not move
INFINITY = float('inf')
Range = tuple[float, float]
Polynomial = tuple[float, ...]
UNLIMITED: Range = (-INFINITY, INFINITY)


class Body(NamedTuple):
    """A rigid body, after its parent in the list of bodies."""

    name: str  # its name, unique
    parent: int  # index of the body that carries it, or WORLD
    # its frame where all its joints are at their zero, seen from the parent's, shape (3, 3)
    rotation: Array
    position: Array  # its origin there, in the frame of the parent [m], shape (3,)
    mass: float = 0.0  # mass [kg]
    centre: Array = np.zeros(3)  # centre of mass in its frame [m], shape (3,)
    # about the centre of mass in its frame [kg m^2], shape (3, 3)
    inertia: Array = np.zeros((3, 3))
    lifted: float = 0.0  # share of its weight that is taken off it


class Joint(NamedTuple):
    """A joint between a body and its parent; those of one body act one after the other."""

    name: str  # its name, unique
    body: int  # index of the body that it moves
    kind: JointKind
    axis: Array  # a unit vector in the frame of the body, shape (3,)
    anchor: Array = np.zeros(3)  # a point on the axis in that frame [m], shape (3,)
    zero: float = 0.0  # its position where the frames of the bodies were read [rad or m]
    lower: float = -INFINITY  # least position [rad or m]
    upper: float = INFINITY  # greatest position [rad or m]
    effort: Range = UNLIMITED  # least and greatest torque or force [N m or N]
    velocity: float = INFINITY  # greatest rate [rad/s or m/s]
    # viscous friction [N m s/rad or N s/m], and its growth: v (d0 + d1 |v| + d2 v^2 + ...)
    damping: Polynomial = ()
    coulomb: float = 0.0  # dry friction [N m or N]
    armature: float = 0.0  # inertia of the rotor, as felt at the joint [kg m^2 or kg]
    # of its spring [N m/rad or N/m], x from `rest`: x (k0 + k1 x + k2 x^2 + ...)
    stiffness: Polynomial = ()
    rest: float = 0.0  # position where the spring is slack [rad or m]


class Frame(NamedTuple):
    """A frame on a body, or in the world."""

    body: int  # index of the body, or WORLD
    rotation: Array = np.eye(3)  # shape (3, 3), seen from the body
    position: Array = np.zeros(3)  # its origin in the frame of the body [m], shape (3,)


class Loop(NamedTuple):
    """Two frames that coincide."""

    name: str  # what the file calls it
    first: Frame  # one frame
    second: Frame  # the other
    turns: bool  # whether their rotations coincide as well as their origins


class Coupling(NamedTuple):
    """A joint that follows another: position = offset + ratio * position of the other."""

    name: str  # what the file calls it
    joint: str  # the joint that follows
    other: str  # the other; empty: the joint does not move
    ratio: float = 1.0  # ratio of their motions
    offset: float = 0.0  # position where the other is at zero [rad or m]


class Tendon(NamedTuple):
    """A length that is a sum of joint positions times ratios, and what acts along it."""

    name: str  # what the file calls it
    ratios: dict[str, float]  # by joint
    lower: float = -INFINITY  # least length
    upper: float = INFINITY  # greatest length
    damping: Polynomial = ()  # as of a joint, of its rate
    coulomb: float = 0.0  # dry friction
    armature: float = 0.0  # inertia that its rate is felt with
    stiffness: Polynomial = ()  # as of a joint
    rest: Range = (0.0, 0.0)  # lengths between which the spring is slack


class Actuator(NamedTuple):
    """What drives a joint; all numbers as they are felt at the joint."""

    name: str  # what the file calls it
    joint: str  # the joint that it drives
    effort: Range = UNLIMITED  # least and greatest torque or force [N m or N]
    armature: float = 0.0  # inertia of the rotor [kg m^2 or kg]
    damping: Polynomial = ()  # as of a joint
    lag: float = 0.0  # time constant of its torque [s]
    delay: float = 0.0  # of its commands [s]


class Description(NamedTuple):
    """A robot as its file describes it."""

    source: str  # what the file is called in messages
    bodies: tuple[Body, ...]  # each after its parent
    joints: tuple[Joint, ...]  # in the order of their bodies
    loops: tuple[Loop, ...]  # frames that coincide
    couplings: tuple[Coupling, ...]  # joints that follow others
    tendons: tuple[Tendon, ...]  # lengths along which something acts
    actuators: tuple[Actuator, ...]  # what drives joints
    frames: dict[str, Frame]  # frames by name: sites, links, bodies
    # postures by name: joint to position, of a ball a quaternion (w, x, y, z)
    keyframes: dict[str, dict[str, float | tuple[float, ...]]]
    gravity: Array  # acceleration of gravity [m/s^2], shape (3,)
    doubts: tuple[str, ...]  # what was read in a way that its author may not expect


def chain(parents: Sequence[int], first: int) -> list[int]:
    """The indices from one on to that whose parent is WORLD."""
    found = []
    while first != WORLD:
        found.append(first)
        first = parents[first]
    return found


def held_by_loops(description: Description) -> set[int]:
    """The bodies between what loops join."""
    parents = [body.parent for body in description.bodies]
    ends = ((loop.first.body, loop.second.body) for loop in description.loops)
    return {body for a, b in ends for body in {*chain(parents, a)} ^ {*chain(parents, b)}}


def added(*polynomials: Polynomial) -> Polynomial:
    """The sum of polynomials by their coefficients."""
    return tuple(map(sum, zip_longest(*polynomials, fillvalue=0.0)))


def slides_of(name: str) -> tuple[str, ...]:
    """Names of the slides of a joint that lets its body float; its ball has its own."""
    return tuple(f'{name}.p{axis}' for axis in 'xyz')


# Names of parts of a robot in messages.

FEW = 8  # names that a message lists


def listed(names: Iterable[str]) -> str:
    """The first names, and how many more there are."""
    found = list(names)
    more = f' and {len(found) - FEW} more' if len(found) > FEW else ''
    return ', '.join(map(printable, found[:FEW])) + more


# Numbers of a description, and those that no machine has.

LARGEST_NUMBER = 1e9  # kg, m, kg m^2 and so on
LIMITS = ('lower', 'upper', 'effort', 'velocity')  # of parts, which may be infinite


def leaves(value: Any) -> Iterator[float | str]:
    """The numbers and texts in tuples, arrays and mappings, one after the other."""
    if isinstance(value, (float, int, str)):
        yield value
    else:
        for each in value.items() if isinstance(value, dict) else value:
            yield from leaves(each)


def check_bounds(description: Description) -> None:
    """Refuse numbers that are not finite, or so large that they overflow later; swapped ends.

    Raises:
        InputError: there is one.
    """
    for name, part in _parts(description):
        values = [value for value in leaves(part) if not isinstance(value, str)]
        if not all(abs(value) < LARGEST_NUMBER for value in values):
            raise InputError(
                f'{description.source}: {name} has a number that is not below {LARGEST_NUMBER:g}'
            )
    for joint in description.joints:
        if joint.lower > joint.upper:
            raise InputError(
                f'{description.source}: the travel of joint {printable(joint.name)!r} has its '
                f'ends swapped: from {joint.lower:.4g} to {joint.upper:.4g}'
            )


def _parts(description: Description) -> Iterator[tuple[str, Any]]:
    """What parts are called, and what they say but for limits."""
    d = description
    for kind, parts in (
        ('body', d.bodies), ('joint', d.joints), ('tendon', d.tendons),
        ('actuator', d.actuators), ('loop', d.loops), ('coupling', d.couplings),
    ):  # fmt: skip
        for part in parts:
            said = {key: each for key, each in part._asdict().items() if key not in LIMITS}
            yield f'{kind} {printable(part.name)!r}', said
    for kind, named in (('frame', d.frames), ('keyframe', d.keyframes)):
        yield from ((f'{kind} {printable(name)!r}', each) for name, each in named.items())
    yield 'gravity', d.gravity


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
