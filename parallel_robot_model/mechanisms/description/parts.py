"""What a description says of a robot: bodies, joints, what closes loops, actuators, frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
