"""SDF: one model whose joints may close loops."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import TEXT, Node, children, refused
from parallel_robot_model.mechanisms.description.graph import (
    Edge,
    Notes,
    acted_on,
    attribute,
    check_held,
    child,
    followers,
    hear,
    inverse,
    is_true,
    left_out,
    link,
    name_of,
    number,
    numbers,
    of_element,
    of_quaternion,
    spread,
    steps,
    turned,
    unique,
    unknown,
    vector,
)
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    INFINITY,
    UNLIMITED,
    WORLD,
    Body,
    Description,
    Frame,
    Joint,
    listed,
)
from parallel_robot_model.mechanisms.description.tree import joined

# Where the links, joints and frames of an SDF model are, each relative to another.

OWN = '__model__'  # the frame of the model
BASE = 'world'  # what SDF calls the world


def pose(node: Node | None) -> Frame:
    """The frame that an element <pose> gives."""
    if node is None:
        return Frame(WORLD)
    node.asked |= {TEXT, 'relative_to', 'frame'}
    way, text = node.get('rotation_format', 'euler_rpy'), node.text or ''
    degrees = is_true(node.get('degrees', 'false'))
    if way == 'quat_xyzw':
        found = numbers(node, text or '0 0 0 0 0 0 1', 'pose', 7)
        return Frame(WORLD, of_quaternion(node, found[3:]), found[:3])
    if way != 'euler_rpy':
        raise refused(node, f'rotation_format={printable(way)!r} must be euler_rpy or quat_xyzw')
    x, y, z, *angles = numbers(node, text or '0 0 0 0 0 0', 'pose', 6)
    if degrees:
        angles = [float(np.radians(angle)) for angle in angles]
    return Frame(WORLD, turned(*angles), np.array([x, y, z]))


class Poses:
    """Frames of a model in the world at the zero of its joints."""

    def __init__(
        self,
        model: Node,
        axes_in_model: bool,
        nodes: Sequence[Node] = (),
        places: Mapping[str, Frame] | None = None,
    ) -> None:
        """Note what has a name."""
        self._own = [each for tag in TAGS for each in children(model, tag)]
        self._nodes = {name_of(node): node for node in (*self._own, *nodes)}
        self._found: dict[str, Frame] = dict(places or {})
        self._links = [name_of(each) for each in self._own if each.tag == 'link']
        self._links += self._found
        self._canonical = model.get('canonical_link') or next(iter(self._links), '')
        self.model, self.axes_in_model = Frame(WORLD), axes_in_model

    def move(self, model: Node, world: Poses) -> None:
        """Place the model in the world as it says."""
        at, placed = child(model, 'pose'), model.get('placement_frame')
        start = _named(at)
        first = world.of(model, start) if start else Frame(WORLD)
        here = joined(first, pose(at))
        if placed:
            here = joined(here, inverse(self.of(model, placed)))
        self._found.clear()
        self.model = here

    def of(self, asking: Node, name: str) -> Frame:
        """What has a name."""
        chain: list[Node] = []
        while name not in self._found and name not in (OWN, BASE):
            node = self._nodes.get(name)
            if node is None:
                raise unknown(chain[-1] if chain else asking, 'frame', name)
            if node in chain:
                raise refused(node, 'has a pose that is relative to itself')
            chain.append(node)
            name = _relative(node)
        frame = Frame(WORLD) if name == BASE else self._found.get(name, self.model)
        for node in reversed(chain):
            frame = joined(frame, pose(child(node, 'pose')))
            self._found[name_of(node)] = frame
        return frame

    def carrier(self, asking: Node, name: str) -> str:
        """The link that carries a link, frame or joint, or the world."""
        seen = set()
        while name != BASE and name not in self._links:
            node = self._nodes.get(name)
            if node is None and name != OWN:
                raise unknown(asking, 'link or frame', name)
            if name in seen:
                raise refused(asking, f'hangs on {printable(name)!r}, which hangs on itself')
            seen.add(name)
            if node is None:
                name = self._canonical
            elif node.tag == 'joint':
                name = of_element(node, 'child') or ''
            else:
                name = node.get('attached_to') or OWN
        return name

    def on_link(self, node: Node, frames: Mapping[str, Frame]) -> Frame:
        """A frame of the model on the link that carries it."""
        name = self.carrier(node, name_of(node))
        here = joined(inverse(self.of(node, name)), self.of(node, name_of(node)))
        return joined(frames[name], here)


TAGS = 'frame', 'joint', 'link'


def _named(at: Node | None) -> str:
    """The name of what a pose is relative to, if it says so."""
    return '' if at is None else at.get('relative_to') or at.get('frame') or ''


def _relative(node: Node) -> str:
    """The name of what the pose of an element is relative to."""
    named = _named(child(node, 'pose'))
    if named or node.tag == 'link':
        return named or OWN
    if node.tag == 'joint':
        return of_element(node, 'child') or OWN
    return node.get('attached_to') or OWN


GRAVITY = 0.0, 0.0, -9.8  # m/s^2, of SDF
ENDLESS = 1e16  # for SDF
AXES_IN_JOINTS = 1, 5  # version since which axes are seen from joints, not from the model
OFTEN_OFF = 'enable_wind', 'kinematic', 'wind', 'velocity_decay'  # zero: without effect


def read(root: Node, source: str) -> Description:
    """A description from SDF."""
    world = child(root, 'world')
    model = _model(root if world is None else world, source)
    notes: Notes = defaultdict(list)
    poses = Poses(model, _version(root) < AXES_IN_JOINTS)
    poses.move(model, Poses(Node('world') if world is None else world, False))
    weightless = not is_true(of_element(model, 'gravity') or '1')
    nodes = unique(children(model, 'link')).values()
    links = [_link(node, weightless) for node in nodes]
    joints = unique(children(model, 'joint'))
    edges = [edge(node, poses, notes) for node in joints.values()]
    if links and BASE not in {end for each in edges for end in (each.parent, each.child)}:
        first = links[0].name
        notes['no joint fixes a link to the world, held is'].append(first)
        edges.append(Edge(model, BASE, BASE, first, poses.of(model, first), Frame(WORLD), ()))
    base = Body(BASE, WORLD, np.eye(3), np.zeros(3))
    found = spread(source, [base, *links] if links else [], edges, [BASE], True)
    check_held(found, edges)
    frames = found.frames
    for node in children(model, 'frame'):
        frames.setdefault(name_of(node), poses.on_link(node, found.frames))
    physics = [] if world is None else children(world, 'physics')
    owners = [each for each in (world, *physics) if each is not None]
    owner = next((each for each in owners if each.find('gravity') is not None), None)
    gravity = vector(owner, 'gravity', GRAVITY, of_element)
    for each in physics:  # gravity stood there before SDF 1.6
        hear(each)
    doubts = [f'{what}: {listed(names)}' for what, names in notes.items()]
    return found._replace(
        couplings=tuple(followers(joints, of_element)),
        gravity=gravity,
        doubts=(*doubts, *left_out(root)),
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
    for node in children(parent, 'joint'):
        raise refused(node, 'joins models; write it and its links in one model')
    models = children(parent, 'model')
    still = [node for node in models if is_true(of_element(node, 'static') or '0')]
    moving = [node for node in models if node not in still]
    for node in still:
        hear(node)
    if not moving:
        raise InputError(f'{source} has no model that moves')
    if len(moving) > 1:
        names = listed(node.get('name', '') for node in moving)
        raise InputError(f'{source} has {len(moving)} models that move; keep one of {names}')
    nested = child(moving[0], 'model')
    if nested is not None:
        raise refused(nested, 'is a model in a model; write its links in the outer one')
    for node in parent, moving[0], *children(moving[0], 'link'):
        for each in (each for each in children(node) if each.tag in OFTEN_OFF):
            words = ' '.join(each.itertext()).lower().split()
            if all(word.strip('-0.') in ('', 'false') for word in words):
                hear(each)
    return moving[0]


def _link(node: Node, weightless: bool) -> Body:
    inertial = child(node, 'inertial')
    frame = pose(child(inertial, 'pose'))
    if inertial is not None and inertial.get('auto') == 'true':
        raise refused(node, 'has an inertia that follows from its shapes; write its numbers')
    mass = number(inertial, 'mass', 1.0, of_element)  # the defaults of SDF
    found = link(node, inertial, frame, mass, of_element, 1.0)
    weightless = weightless or not is_true(of_element(node, 'gravity') or '1')
    return found._replace(lifted=float(weightless))


def edge(node: Node, poses: Poses, notes: Notes) -> Edge:
    """A joint."""
    ends = []
    for tag in ('parent', 'child'):
        name = of_element(node, tag)
        if not name:
            raise refused(node, f'has no {tag}')
        ends.append(poses.carrier(node, name))
    if ends[0] == ends[1]:
        raise refused(node, f'joins the link {printable(ends[0])!r} with itself')
    kind, name = attribute(node, 'type'), name_of(node)
    here = joined(poses.of(node, _relative(node)), pose(child(node, 'pose')))
    sides = [joined(inverse(poses.of(node, end)), here) for end in ends]
    axes = [each for tag in ('axis', 'axis2') if (each := child(node, tag)) is not None]
    how = list(steps(node, kind, [_direction(node, axis, poses, here) for axis in axes]))
    for i, (step, axis) in enumerate(zip(how, axes, strict=False)):
        how[i] = _limited(step, name, axis, kind, notes)
    for axis in axes[len(how) :]:  # of a fixed joint
        hear(axis)
    child(node, 'physics')
    rotor, ratio = (
        number(node, f'drake:{key}', default, of_element)
        for key, default in (('rotor_inertia', 0.0), ('gear_ratio', 1.0))
    )
    if how and rotor:
        how[0] = how[0]._replace(armature=rotor * ratio**2)
    return Edge(node, name, ends[0], ends[1], sides[0], sides[1], tuple(how))


def _direction(node: Node, axis: Node, poses: Poses, here: Frame) -> Array:
    """An axis in the frame of its joint."""
    of_model = is_true(of_element(axis, 'use_parent_model_frame') or '0')
    direction, vertical = child(axis, 'xyz'), (0.0, 0.0, 1.0)
    if direction is None:
        return np.array(vertical)
    seen_from = direction.get('expressed_in', '')
    found = vector(axis, 'xyz', vertical, of_element)
    if poses.axes_in_model or of_model:
        found = here.rotation.T @ poses.model.rotation @ found
    elif seen_from:
        found = here.rotation.T @ poses.of(node, seen_from).rotation @ found
    return found


def _limited(step: Joint, name: str, axis: Node, kind: str, notes: Notes) -> Joint:
    """A joint with what acts on it, and its limits."""
    limit = child(axis, 'limit')
    step = acted_on(step, name, limit, child(axis, 'dynamics'), of_element, notes)
    for key in ('stiffness', 'dissipation'):  # of the stops
        hear(child(limit, key))
    lower = number(limit, 'lower', -INFINITY, of_element)
    upper = number(limit, 'upper', INFINITY, of_element)
    if kind == 'continuous' or step.kind == BALL:
        lower, upper = UNLIMITED
    return step._replace(
        lower=lower if lower > -ENDLESS else -INFINITY,
        upper=upper if upper < ENDLESS else INFINITY,
    )
