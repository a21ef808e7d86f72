"""A mechanism as a value: arrays for a tree of hinges and slides and for what closes its loops.

One compiled set of kernels serves all mechanisms, whatever their number of joints. A joint has a
frame that moves with its body and whose origin lies on its axis. A ball is three hinges, a
universal joint two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array

Index = NDArray[np.int64]

HINGE, SLIDE = 0, 1  # kinds of joints
POINT, TURN, COUPLING = 0, 1, 2  # kinds of closures
BASE = -1  # in place of a joint: what does not move


class Mechanism(NamedTuple):
    """A mechanism of N joints, r closures, n actuated joints and m coordinates of its tool.

    As many closures as passive joints, independent of each other at home. The joint `parent[i]`
    comes before joint i.

    Attributes:
        parent: The joint before on the chain, or BASE, shape (N,).
        kind: HINGE or SLIDE, shape (N,).
        rotation: Frame of the joint at position zero, seen from that of its parent, shape
            (N, 3, 3).
        origin: Its origin in the frame of the parent [m], shape (N, 3).
        axis: Its axis in its own frame, a unit vector, shape (N, 3).
        mass: Mass of its body [kg], shape (N,).
        centre: Centre of mass in its frame [m], shape (N, 3).
        inertia: About the centre of mass in its frame [kg m^2], shape (N, 3, 3).
        armature: Inertia of its rotor, as felt at the joint [kg m^2 or kg], shape (N,).
        gravity: Acceleration of gravity in the world [m/s^2], shape (3,).
        closure: Kind of each closure, shape (r,). POINT: a component of the distance between a
            point on joint a and one on joint b is zero; TURN: a component of the rotation from
            one to the other is; COUPLING: position of joint a = offset + ratio * position of b.
        first: Joint a of the closure, or BASE, shape (r,).
        second: Joint b of the closure, or BASE, shape (r,).
        first_point: The point in the frame of joint a [m], shape (r, 3); POINT alone.
        second_point: That in the frame of joint b [m], shape (r, 3); POINT alone.
        turned: Rotation of b seen from a where the closure is met, shape (r, 3, 3); TURN alone.
        direction: Which component, a unit vector of the world, shape (r, 3).
        ratio: Of a COUPLING, shape (r,).
        offset: Of a COUPLING [rad or m], shape (r,).
        actuated: The n actuated joints, shape (n,).
        passive: The r joints that follow by the closures, shape (r,).
        home: Positions of all joints in a closed posture [rad or m], shape (N,); joints that are
            neither actuated nor passive are held there.
        tool: The joint that carries the tool, or BASE.
        tool_point: The tool in the frame of that joint [m], shape (3,).
        tool_rotation: Frame of the tool seen from that of the joint, shape (3, 3).
        tool_home: Frame of the tool in the world at home, shape (3, 3).
        coordinate: Coordinates of the pose, shape (m,): 0 to 2 are x, y, z of the tool [m], 3 to 5
            the components of its rotation vector from `tool_home` in the world [rad]; empty: the
            pose is the actuated joints.
        length: A length of the machine, by which angles and lengths are compared [m].
    """

    parent: Index
    kind: Index
    rotation: Array
    origin: Array
    axis: Array
    mass: Array
    centre: Array
    inertia: Array
    armature: Array
    gravity: Array
    closure: Index
    first: Index
    second: Index
    first_point: Array
    second_point: Array
    turned: Array
    direction: Array
    ratio: Array
    offset: Array
    actuated: Index
    passive: Index
    home: Array
    tool: int
    tool_point: Array
    tool_rotation: Array
    tool_home: Array
    coordinate: Index
    length: float
