"""Links and joints of URDF and SDF as a tree of bodies and what closes its loops."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import Node, children, refused
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

# Numbers, vectors and frames in the attributes and texts of XML.

MOMENTS = ('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz')


def child(node: Node, tag: str) -> Node | None:
    """The first element of a kind in an element."""
    return next(iter(children(node, tag)), None)


def name_of(node: Node) -> str:
    """The name of an element.

    Raises:
        InputError: it has none.
    """
    return attribute(node, 'name')


def attribute(node: Node, key: str) -> str:
    """An attribute that must be there.

    Raises:
        InputError: it is missing or empty.
    """
    value = node.get(key, '')
    if not value:
        raise refused(node, f'has no {key}')
    return value


def numbers(node: Node, text: str, what: str, count: int) -> Array:
    """Finite numbers in a text, shape (count,).

    Args:
        node: Where the text stands.
        text: Numbers and spaces.
        what: What the text is called in messages.
        count: How many there must be.

    Raises:
        InputError: it is something else.
    """
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.array([])
    if len(found) != count or not np.isfinite(found).all():
        wanted = 'a finite number' if count == 1 else f'{count} finite numbers'
        raise refused(node, f'{what}={printable(text.strip())!r} must be {wanted}')
    return found


def number(node: Node | None, key: str, default: float = 0.0) -> float:
    """A number in an attribute of an element that may be missing.

    Raises:
        InputError: it is none.
    """
    text = None if node is None else node.get(key)
    if node is None or text is None:
        return default
    return float(numbers(node, text, key, 1)[0])


def vector(node: Node | None, key: str, default: tuple[float, ...]) -> Array:
    """Numbers in an attribute of an element that may be missing, as many as by default.

    Raises:
        InputError: they are none, or more or fewer.
    """
    text = None if node is None else node.get(key)
    if node is None or text is None:
        return np.array(default)
    return numbers(node, text, key, len(default))


def unit(node: Node, axis: Array) -> Array:
    """An axis of length one.

    Raises:
        InputError: it is zero.
    """
    largest = float(np.abs(axis).max())
    if not largest:
        raise refused(node, 'has an axis of zeros')
    axis = axis / largest
    return axis / np.linalg.norm(axis)


def turned(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation about the fixed x, y and z axes, one after the other, shape (3, 3)."""
    if not (roll or pitch or yaw):
        return np.eye(3)
    return np.asarray(Rotation.from_euler('xyz', (roll, pitch, yaw)).as_matrix())


def symmetric(moments: Array) -> Array:
    """A symmetric matrix from ixx, iyy, izz, ixy, ixz, iyz, shape (3, 3)."""
    xx, yy, zz, xy, xz, yz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def origin(node: Node | None) -> Frame:
    """The frame that an element <origin> gives.

    Raises:
        InputError: it holds no numbers.
    """
    return Frame(
        WORLD,
        turned(*vector(node, 'rpy', (0.0, 0.0, 0.0))),
        vector(node, 'xyz', (0.0, 0.0, 0.0)),
    )


def inverse(frame: Frame) -> Frame:
    """What a frame is seen from, seen from the frame."""
    back = frame.rotation.T
    return Frame(WORLD, back, -back @ frame.position)


def unique(nodes: list[Node]) -> dict[str, Node]:
    """Elements by name.

    Raises:
        InputError: two have the same.
    """
    found: dict[str, Node] = {}
    for node in nodes:
        if (name := name_of(node)) in found:
            raise refused(node, 'stands twice')
        found[name] = node
    return found


def unknown(node: Node, kind: str, name: str) -> InputError:
    """The error that says that an element names what does not exist."""
    return refused(node, f'names an unknown {kind} {printable(name)!r}')


MOST = 1000  # links
LEVER = 0.1  # m, between two points that keep an axis


class Link(NamedTuple):
    """A link before it has a place: name, mass [kg], centre [m] and inertia [kg m^2]."""

    name: str
    mass: float = 0.0
    centre: Array = np.zeros(3)
    inertia: Array = np.zeros((3, 3))


class Edge(NamedTuple):
    """A joint between two links."""

    node: Node  # its element
    name: str
    parent: str  # name of a link
    child: str  # name of the other
    at: Frame  # its frame on the parent
    back: Frame  # the same frame on the child, at zero
    # its hinges, slides or a ball one after the other from the parent on, with axes in its
    # frame; empty: fixed. Their `name` is the end of a name, or empty; `body` is unset
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
