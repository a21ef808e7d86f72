"""Links and joints of URDF and SDF as a tree of bodies and what closes its loops."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import Node
from parallel_robot_model.mechanisms.description.parts import (
    HINGE,
    SLIDE,
    WORLD,
    Body,
    Frame,
    Joint,
    Loop,
    listed,
)
from parallel_robot_model.mechanisms.description.tree import joined
from parallel_robot_model.mechanisms.description.values import inverse

MOST = 1000  # links
LEVER = 0.1  # m, between two points that keep an axis


class Link(NamedTuple):
    """A link before it has a place: name, mass [kg], centre [m] and inertia [kg m^2]."""

    name: str
    mass: float = 0.0
    centre: Array = np.zeros(3)
    inertia: Array = np.zeros((3, 3))


class Edge(NamedTuple):
    """A joint between two links.

    Attributes:
        node: Its element.
        name: Its name.
        parent: Name of a link.
        child: Name of the other.
        at: Its frame on the parent.
        back: The same frame on the child, at zero.
        steps: Its hinges, slides or a ball one after the other from the parent on, with axes in
            its frame; empty: fixed. Their `name` is the end of a name, or empty; `body` is unset.
    """

    node: Node
    name: str
    parent: str
    child: str
    at: Frame
    back: Frame
    steps: tuple[Joint, ...]


class Graph(NamedTuple):
    """The bodies, joints and loops that links and joints make; `places` are links by name."""

    bodies: list[Body]
    joints: list[Joint]
    loops: list[Loop]
    places: dict[str, int]


def built(
    source: str,
    links: Sequence[Link],
    edges: Sequence[Edge],
    fixed: Sequence[str],
    both_ways: bool,
    driven: Collection[str] = (),
) -> Graph:
    """Spread a tree over links and joints; a joint that finds its child in place closes a loop.

    Args:
        source: What the file is called in messages.
        links: All links.
        edges: The joints.
        fixed: Links that do not move.
        both_ways: Whether a joint may carry its parent.
        driven: Joints that are actuated.

    Raises:
        InputError: there are too many links, or some hang on no link that is fixed.
    """
    if len(links) > MOST:
        raise InputError(f'{source} has {len(links)} links; {MOST} are possible')
    graph = Graph([], [], [], {})
    known = {link.name: link for link in links}
    for name in fixed:
        _place(graph, known[name], Frame(WORLD))
    reached, waiting = list(fixed), list(edges)
    for name in reached:  # it grows
        for edge in [edge for edge in waiting if name in (edge.parent, edge.child)]:
            way = edge if name == edge.parent else _reversed(edge) if both_ways else None
            if way is None:
                continue
            waiting.remove(edge)
            if way.child in graph.places:
                _close(graph, edge, driven)
            else:
                _carry(graph, known[way.child], way)
                reached.append(way.child)
    if left := [link.name for link in links if link.name not in graph.places]:
        what = (
            'that no joints join to the world'
            if both_ways
            else 'that carry each other in a circle'
        )
        raise InputError(f'{source}: links {what}: {listed(left)}')
    return graph


def _place(graph: Graph, link: Link, at: Frame) -> int:
    graph.places[link.name] = len(graph.bodies)
    graph.bodies.append(Body(link.name, at.body, at.rotation, at.position, *link[1:]))
    return len(graph.bodies) - 1


def _carry(graph: Graph, link: Link, edge: Edge) -> int:
    """Add a link that hangs on a joint."""
    at = joined(joined(Frame(graph.places[edge.parent]), edge.at), inverse(edge.back))
    body = _place(graph, link, at)
    for step in edge.steps:
        graph.joints.append(
            step._replace(
                name=edge.name + step.name,
                body=body,
                axis=edge.back.rotation @ step.axis,
                anchor=edge.back.position,
            )
        )
    return body


def _reversed(edge: Edge) -> Edge:
    """The same joint, the parent on the child; positions of hinges and slides keep their sign."""
    steps = tuple(step._replace(axis=-step.axis) for step in reversed(edge.steps))
    return edge._replace(
        parent=edge.child, child=edge.parent, at=edge.back, back=edge.at, steps=steps
    )


def _close(graph: Graph, edge: Edge, driven: Collection[str]) -> None:
    """Close a loop with a joint."""
    first = joined(Frame(graph.places[edge.parent]), edge.at)
    second = joined(Frame(graph.places[edge.child]), edge.back)
    steps, last = edge.steps[:-1], edge.steps[-1:]
    if edge.name in driven or (last and last[0].kind == SLIDE):
        steps, last = edge.steps, ()
    if steps:  # what the loop cannot say is a joint of a body without mass
        own = edge._replace(child=f'{edge.name} (end)', back=Frame(WORLD), steps=steps)
        first = Frame(_carry(graph, Link(own.child), own))
    if last and last[0].kind == HINGE:
        for arm in (np.zeros(3), LEVER * last[0].axis):
            lever = Frame(WORLD, position=arm)
            ends = joined(first, lever), joined(second, lever)
            graph.loops.append(Loop(edge.name, ends[0], ends[1], False))
    else:
        graph.loops.append(Loop(edge.name, first, second, not last))
