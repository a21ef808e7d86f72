"""The equations that close the loops of a tree, and how well a posture meets them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.parts import Description, Frame, Loop
from parallel_robot_model.mechanisms.description.tree import Places, Tree, place
from parallel_robot_model.mechanisms.mechanism import BASE, COUPLING, POINT, TURN


class Equation(NamedTuple):
    """A scalar equation that closes a loop.

    Attributes:
        name: Of the loop or the coupling.
        kind: POINT, TURN or COUPLING.
        first: A frame of a link; of a COUPLING the link alone counts.
        second: The other.
        direction: Which component, a unit vector of the world, shape (3,).
        ratio: Of a COUPLING.
        offset: Of a COUPLING [rad or m].
    """

    name: str
    kind: int
    first: Frame
    second: Frame
    direction: Array = np.zeros(3)
    ratio: float = 0.0
    offset: float = 0.0


def equations(description: Description, tree: Tree) -> tuple[Equation, ...]:
    """All equations of the loops and couplings of a description, redundant ones, too."""
    found = [equation for loop in description.loops for equation in _of_loop(loop, tree)]
    index = {link.name: i for i, link in enumerate(tree.links)}
    for name, joint, other, ratio, offset in description.couplings:
        second = Frame(index[other] if other else BASE)
        found.append(
            Equation(name, COUPLING, Frame(index[joint]), second, ratio=ratio, offset=offset)
        )
    return tuple(found)


def _of_loop(loop: Loop, tree: Tree) -> list[Equation]:
    first, second = tree.on_link(loop.first), tree.on_link(loop.second)
    kinds = (POINT, TURN) if loop.turns else (POINT,)
    return [
        Equation(loop.name, kind, first, second, direction)
        for kind in kinds
        for direction in np.eye(3)
    ]


def residuals(equations: tuple[Equation, ...], places: Places, q: Array) -> Array:
    """By how much a posture misses each equation [m or rad], shape (R,)."""
    missed = []
    for _, kind, first, second, direction, ratio, offset in equations:
        if kind == COUPLING:
            other = 0.0 if second.body == BASE else q[second.body]
            missed.append(q[first.body] - offset - ratio * other)
            continue
        (rotation, point), (other_rotation, other_point) = (
            places.frame(first),
            places.frame(second),
        )
        if kind == POINT:
            missed.append(direction @ (point - other_point))
        else:
            turned = Rotation.from_matrix(rotation @ other_rotation.T)
            missed.append(direction @ turned.as_rotvec())
    return np.array(missed)


def jacobian(equations: tuple[Equation, ...], places: Places) -> Array:
    """Derivative of the residuals by the positions where the equations are met, shape (R, N)."""
    rows = np.zeros((len(equations), len(places.axis)))
    for row, (_, kind, first, second, direction, ratio, _) in zip(rows, equations, strict=True):
        if kind == COUPLING:
            row[first.body] = 1.0
            if second.body != BASE:
                row[second.body] -= ratio
            continue
        one, other = places.rates(first), places.rates(second)
        row[:] = direction @ (one[kind != POINT] - other[kind != POINT])
    return rows


def missed(equations: tuple[Equation, ...], tree: Tree, q: Array) -> Array:
    """Residuals at positions [rad or m], shape (R,)."""
    return residuals(equations, place(tree, q), q)
