"""A link of a robot, and the joint about which it turns."""

from __future__ import annotations

from typing import NamedTuple

Point = tuple[float, float]


class Link(NamedTuple):
    """A link and the joint that it turns about.

    Attributes:
        name: Name of the link and of its frame.
        parent: Name of the link that carries it, or the fixed frame.
        joint: Name of its joint, whose axis is z.
        origin: The joint in the frame of the parent [m].
        mass: Mass [kg].
        centre: Centre of mass in its own frame [m].
        inertia: About z through the centre of mass [kg m^2].
        lines: Both ends of each straight line of a picture, in its own frame [m].
    """

    name: str
    parent: str
    joint: str
    origin: Point
    mass: float
    centre: Point
    inertia: float
    lines: tuple[tuple[Point, Point], ...]
