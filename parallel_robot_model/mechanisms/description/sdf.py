"""SDF: one model whose joints may close loops."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.graph import (
    MOMENTS,
    Edge,
    Link,
    attribute,
    built,
    child,
    inverse,
    name_of,
    numbers,
    symmetric,
    turned,
    unique,
    unit,
    unknown,
)
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    HINGE,
    SLIDE,
    UNLIMITED,
    WORLD,
    Coupling,
    Description,
    Frame,
    Joint,
    listed,
)
from parallel_robot_model.mechanisms.description.tree import joined

# Where the links, joints and frames of an SDF model are, each relative to another.

OWN = '__model__'  # the frame of the model
WORLD_NAME = 'world'


def pose(node: Node | None) -> Frame:
    """The frame that an element <pose> gives.

    Raises:
        InputError: it holds no numbers.
    """
    if node is None or not (node.text or '').strip():
        return Frame(WORLD)
    if node.get('rotation_format', 'euler_rpy') != 'euler_rpy':
        raise refused(node, 'must be x y z roll pitch yaw')
    x, y, z, *angles = numbers(node, node.text or '', 'pose', 6)
    if node.get('degrees') == 'true':
        angles = [float(np.radians(angle)) for angle in angles]
    return Frame(WORLD, turned(*angles), np.array([x, y, z]))


class Poses:
    """Frames of a model in the world at the zero of its joints."""

    def __init__(self, model: Node, axes_in_model: bool) -> None:
        """Note what has a name.

        Args:
            model: The element <model>.
            axes_in_model: Whether axes of joints are seen from the model.
        """
        self._nodes = {
            name_of(node): node
            for tag in ('frame', 'joint', 'link')
            for node in children(model, tag)
        }
        # the frame of the model, and whether axes of joints are seen from it
        self.model, self.axes_in_model = pose(child(model, 'pose')), axes_in_model
        self._found: dict[str, Frame] = {}

    def of_link(self, name: str) -> Frame:
        """A link, or the world."""
        return Frame(WORLD) if name == WORLD_NAME else self.of(self._nodes[name], name)

    def of_joint(self, node: Node) -> Frame:
        """The frame of a joint."""
        return self.of(node, name_of(node))

    def of(self, asking: Node, name: str) -> Frame:
        """What has a name.

        Raises:
            InputError: nothing has, or it is relative to itself.
        """
        chain: list[Node] = []
        while name not in self._found and name not in (OWN, WORLD_NAME):
            node = self._nodes.get(name)
            if node is None:
                raise unknown(asking, 'frame', name)
            if node in chain:
                raise refused(node, 'has a pose that is relative to itself')
            chain.append(node)
            name = _relative(node)
        frame = Frame(WORLD) if name == WORLD_NAME else self._found.get(name, self.model)
        for node in reversed(chain):
            frame = joined(frame, pose(child(node, 'pose')))
            self._found[name_of(node)] = frame
        return frame

    def on_link(self, node: Node, links: dict[str, Frame]) -> Frame:
        """A frame of the model on the link that it is attached to."""
        link = node.get('attached_to', '')
        seen = set()
        while link in self._nodes and link not in links and link not in seen:
            seen.add(link)
            link = self._nodes[link].get('attached_to', '')
        if link not in links:
            return self.of(node, name_of(node))
        return joined(
            links[link], joined(inverse(self.of_link(link)), self.of(node, name_of(node)))
        )


def _relative(node: Node) -> str:
    """The name of what the pose of an element is relative to."""
    own = child(node, 'pose')
    named = '' if own is None else own.get('relative_to') or own.get('frame') or ''
    if named or node.tag == 'link':
        return named or OWN
    if node.tag == 'joint':
        carried = child(node, 'child')
        return OWN if carried is None else (carried.text or '').strip()
    return node.get('attached_to') or OWN


BASE = 'world'  # what SDF calls the world
KINDS = {
    'revolute': (HINGE,), 'continuous': (HINGE,), 'prismatic': (SLIDE,), 'fixed': (),
    'ball': (BALL,), 'universal': (HINGE, HINGE), 'revolute2': (HINGE, HINGE),
}  # fmt: skip
GRAVITY = 0.0, 0.0, -9.8  # m/s^2, of SDF
ENDLESS = 1e16  # for SDF
AXES_IN_JOINTS = 1, 5  # version since which axes are seen from joints, not from the model


def read(root: Node, source: str) -> Description:
    """A description from SDF.

    Args:
        root: The element <sdf>.
        source: What the file is called in messages.

    Raises:
        InputError: it is no valid SDF, holds several robots, or one has what this suite does not
            know.
    """
    world = child(root, 'world')
    model = _model(root if world is None else world, source)
    links = {name: _link(node) for name, node in unique(children(model, 'link')).items()}
    joints = unique(children(model, 'joint'))
    poses = Poses(model, _version(root) < AXES_IN_JOINTS)
    edges = [_edge(node, links, poses) for node in joints.values()]
    doubts, start = [], []
    if BASE not in {end for edge in edges for end in (edge.parent, edge.child)}:
        if not links:
            raise InputError(f'{source} has no links')
        first = next(iter(links))
        doubts.append(f'no joint fixes a link to the world: {printable(first)!r} is held')
        edges.append(Edge(model, BASE, BASE, first, poses.of_link(first), Frame(WORLD), ()))
    start = [Link(BASE), *links.values()]
    graph = built(source, start, edges, [BASE], True)
    frames = {name: Frame(body) for name, body in graph.places.items()}
    for node in children(model, 'frame'):
        frames.setdefault(name_of(node), poses.on_link(node, frames))
    gravity = None if world is None else child(world, 'gravity')
    return Description(
        source=source,
        bodies=tuple(graph.bodies),
        joints=tuple(graph.joints),
        loops=tuple(graph.loops),
        couplings=tuple(_mimics(joints)),
        tendons=(),
        actuators=(),
        frames=frames,
        keyframes={},
        gravity=np.array(GRAVITY) if gravity is None else _texts(gravity, 3),
        doubts=tuple(doubts),
    )


def _version(root: Node) -> tuple[int, ...]:
    """The version of SDF, by default the newest."""
    words = root.get('version', '').split('.')
    return tuple(map(int, words)) if all(word.isdecimal() for word in words) else AXES_IN_JOINTS


def _model(parent: Node, source: str) -> Node:
    """The one model that moves."""
    for tag in ('include', 'population'):
        found = next(parent.iter(tag), None)
        if found is not None:  # an element without children counts as false
            assert isinstance(found, Node)
            raise refused(found, 'is another file; write its model in its place')
    models = children(parent, 'model')
    moving = [node for node in models if _text(node, 'static') not in ('1', 'true')]
    if not moving:
        raise InputError(f'{source} has no model that moves')
    if len(moving) > 1:
        names = listed(node.get('name', '') for node in moving)
        raise InputError(f'{source} has {len(moving)} models that move; keep one of {names}')
    nested = child(moving[0], 'model')
    if nested is not None:
        raise refused(nested, 'is a model in a model; write its links in the outer one')
    return moving[0]


def _text(node: Node | None, tag: str, default: str = '') -> str:
    """The text of an element in an element."""
    found = None if node is None else child(node, tag)
    return default if found is None else (found.text or '').strip()


def _texts(node: Node, count: int) -> Array:
    return numbers(node, node.text or '', str(node.tag), count)


def _number(node: Node | None, tag: str, default: float = 0.0) -> float:
    found = None if node is None else child(node, tag)
    return default if found is None else float(_texts(found, 1)[0])


def _link(node: Node) -> Link:
    inertial = child(node, 'inertial')
    if inertial is None:
        return Link(name_of(node), 1.0, np.zeros(3), np.eye(3))  # the defaults of SDF
    if inertial.get('auto') == 'true':
        raise refused(node, 'has an inertia that follows from its shapes; write its numbers')
    frame, moments = pose(child(inertial, 'pose')), child(inertial, 'inertia')
    inertia = symmetric(
        np.array([_number(moments, key, float(key[1] == key[2])) for key in MOMENTS])
    )
    mass = _number(inertial, 'mass', 1.0)
    if mass < 0.0:
        raise refused(node, f'has a negative mass, {mass:g} kg')
    return Link(name_of(node), mass, frame.position, frame.rotation @ inertia @ frame.rotation.T)


def _edge(node: Node, links: dict[str, Link], poses: Poses) -> Edge:
    ends = [_text(node, tag) for tag in ('parent', 'child')]
    for name in ends:
        if name != BASE and name not in links:
            raise unknown(node, 'link', name)
    if ends[0] == ends[1]:
        raise refused(node, f'joins the link {printable(ends[0])!r} with itself')
    kind = attribute(node, 'type')
    if kind not in KINDS:
        known = ', '.join(KINDS)
        raise refused(node, f'is of an unknown type {printable(kind)!r} (known: {known})')
    here = poses.of_joint(node)
    sides = [joined(inverse(poses.of_link(name)), here) for name in ends]
    kinds = KINDS[kind]
    suffixes = ('.1', '.2') if len(kinds) == 2 else ('',)
    axes = [child(node, tag) for tag in ('axis', 'axis2')]
    steps = tuple(
        _step(node, axis, of, suffix, poses, here, kind)
        for of, axis, suffix in zip(kinds, axes, suffixes, strict=False)
    )
    return Edge(node, name_of(node), ends[0], ends[1], sides[0], sides[1], steps)


def _step(
    node: Node, axis: Node | None, kind: str, name: str, poses: Poses, here: Frame, joint: str
) -> Joint:
    """A hinge, a slide or a ball with its axis in the frame of the joint."""
    direction = None if axis is None else child(axis, 'xyz')
    if direction is None and kind != BALL:
        raise refused(node, 'has no axis')
    vector = np.array((0.0, 0.0, 1.0)) if direction is None else _texts(direction, 3)
    seen_from = '' if direction is None else direction.get('expressed_in', '')
    if poses.axes_in_model or _text(axis, 'use_parent_model_frame') in ('1', 'true'):
        vector = here.rotation.T @ poses.model.rotation @ vector
    elif seen_from:
        vector = here.rotation.T @ poses.of(node, seen_from).rotation @ vector
    limit, dynamics = (None if axis is None else child(axis, tag) for tag in ('limit', 'dynamics'))
    lower, upper = _number(limit, 'lower', -np.inf), _number(limit, 'upper', np.inf)
    if joint == 'continuous' or max(abs(lower), abs(upper)) >= ENDLESS:
        lower, upper = -np.inf, np.inf
    effort, velocity = _number(limit, 'effort', -1.0), _number(limit, 'velocity', -1.0)
    return Joint(
        name=name,
        body=WORLD,
        kind=kind,
        axis=unit(node, vector),
        lower=lower,
        upper=upper,
        effort=(-effort, effort) if effort > 0.0 else UNLIMITED,
        velocity=velocity if velocity > 0.0 else np.inf,
        damping=(_number(dynamics, 'damping'),),
        coulomb=_number(dynamics, 'friction'),
    )


def _mimics(joints: dict[str, Node]) -> list[Coupling]:
    """The joints that follow others: position = ratio (other - reference) + offset."""
    found = []
    for name, node in joints.items():
        axis = child(node, 'axis')
        mimic = None if axis is None else child(axis, 'mimic')
        if mimic is None:
            continue
        other = attribute(mimic, 'joint')
        if other not in joints or other == name:
            raise unknown(node, 'joint', other)
        ratio = _number(mimic, 'multiplier', 1.0)
        offset = _number(mimic, 'offset') - ratio * _number(mimic, 'reference')
        found.append(Coupling(f'mimic of {name}', name, other, ratio, offset))
    return found
