"""URDF, with what closes loops: mimic, constraint, loop, coupling, closed_loop, two parents."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.graph import (
    MOMENTS,
    Edge,
    Link,
    attribute,
    built,
    child,
    name_of,
    number,
    origin,
    symmetric,
    unique,
    unit,
    unknown,
    vector,
)
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    HINGE,
    SLIDE,
    WORLD,
    Actuator,
    Coupling,
    Description,
    Frame,
    Joint,
    Loop,
    listed,
)

# What closes loops in URDF, of several authors.
#
# Sources:
#     `constraint`: pull requests ros/urdfdom_headers#108 and ros/urdfdom#264 (2026): joints of
#     which both ends have an origin. `loop` and `coupling`: Chignoli, Slotine, Wensing, Kim
#     (2024), URDF+, arXiv 2411.19753. `closed_loop`: see `configuration.robot_file`.

CLOSURE_TAGS = 'constraint', 'loop', 'coupling', 'closed_loop'
AXES = {'X': (1.0, 0.0, 0.0), 'Y': (0.0, 1.0, 0.0), 'Z': (0.0, 0.0, 1.0)}
CLOSURE_KINDS = {
    'revolute': HINGE, 'continuous': HINGE, 'prismatic': SLIDE, 'spherical': BALL, 'ball': BALL,
    'fixed': '', 'link': '',
}  # fmt: skip
ENDS = {'constraint': ('parent', 'child'), 'loop': ('predecessor', 'successor')}


def _kinds_beyond_urdf(robot: Node, joints: Collection[str]) -> dict[str, tuple[Joint, ...]]:
    """The joints that are of another kind than URDF can say."""
    found: dict[str, tuple[Joint, ...]] = {}
    for node in children(robot, 'joint_type'):
        name, kind = attribute(node, 'joint'), attribute(node, 'type').upper()
        if name not in joints:
            raise unknown(node, 'joint', name)
        first, second = kind[-2:-1], kind[-1:]
        if kind == 'SPHERICAL':
            found[name] = (Joint('', WORLD, BALL, np.array(AXES['Z'])),)
        elif kind == 'FIXED':
            found[name] = ()
        elif kind.startswith('UJOINT_') and len(kind) == 9 and {first, second} <= {*AXES}:
            found[name] = tuple(
                Joint(f'.{axis.lower()}', WORLD, HINGE, np.array(AXES[axis]))
                for axis in (first, second)
            )
        else:
            raise refused(
                node, f'type={printable(kind)!r} must be SPHERICAL, FIXED or such as UJOINT_XY'
            )
    return found


def _closing_edges(robot: Node, links: Collection[str]) -> list[Edge]:
    """The joints that close loops."""
    return [_closing_edge(node, links) for tag in ENDS for node in children(robot, tag)]


def _closing_edge(node: Node, links: Collection[str]) -> Edge:
    names, origins = [], []
    for tag in ENDS[str(node.tag)]:
        end = child(node, tag)
        name = '' if end is None else end.get('link', '')
        if end is None or name not in links:
            raise unknown(node, f'{tag} link', name)
        place = child(end, 'origin') if node.tag == 'loop' else child(node, f'{tag}_origin')
        names.append(name)
        origins.append(origin(place))
    return Edge(node, name_of(node), names[0], names[1], origins[0], origins[1], _steps(node))


def _steps(node: Node) -> tuple[Joint, ...]:
    kind = attribute(node, 'type').lower()
    keys = ('axis',) if node.tag == 'loop' else ('parent_axis', 'child_axis')
    if not CLOSURE_KINDS.get(kind, kind):
        return ()
    axes = [unit(node, vector(child(node, key), 'xyz', (1.0, 0.0, 0.0))) for key in keys]
    if kind == 'universal' and len(axes) == 2:
        return tuple(Joint(f'.{i}', WORLD, HINGE, axis) for i, axis in enumerate(axes, 1))
    if kind not in CLOSURE_KINDS:
        known = ', '.join(CLOSURE_KINDS)
        raise refused(node, f'is of an unknown type {printable(kind)!r} (known: {known})')
    return (Joint('', WORLD, CLOSURE_KINDS[kind], axes[0]),)


def _closing_frames(robot: Node, frames: Mapping[str, Frame]) -> list[Loop]:
    """The pairs of frames that coincide."""
    found = []
    for node in children(robot, 'closed_loop'):
        names = attribute(node, 'first'), attribute(node, 'second')
        for name in names:
            if name not in frames:
                raise unknown(node, 'link or joint', name)
        kind = attribute(node, 'type').lower()
        if kind not in ('3d', '6d'):
            raise refused(node, f'type={printable(kind)!r} must be 3d or 6d')
        found.append(Loop(' '.join(names), frames[names[0]], frames[names[1]], kind == '6d'))
    return found


def couplings(robot: Node, edges: Sequence[Edge]) -> list[Coupling]:
    """The joints that gears tie together: successor = ratio * predecessor.

    Raises:
        InputError: a link is unknown, or there is not one joint on each side.
    """
    above = {edge.child: edge for edge in edges if edge.node.tag == 'joint'}
    found = []
    for node in children(robot, 'coupling'):
        sides = []
        for tag in ENDS['loop']:
            end = child(node, tag)
            name = '' if end is None else end.get('link', '')
            if name not in above:
                raise unknown(node, f'{tag} link', name)
            sides.append(_moving(above, name))
        first, second = ([e for e in side if e not in other] for side, other in (
            (sides[0], sides[1]), (sides[1], sides[0])
        ))  # fmt: skip
        if len(first) != 1 or len(second) != 1:
            raise refused(node, 'must tie one joint to one other')
        ratio = number(child(node, 'ratio'), 'value', 1.0)
        found.append(Coupling(name_of(node), second[0], first[0], ratio))
    return found


def _moving(above: Mapping[str, Edge], link: str) -> list[str]:
    """The joints that move a link, up to the base."""
    moving: list[str] = []
    while link in above and above[link].name not in moving:
        edge = above[link]
        moving += [edge.name] if edge.steps else []
        link = edge.parent
    return moving


KINDS = {
    'revolute': HINGE, 'continuous': HINGE, 'prismatic': SLIDE, 'fixed': '', 'spherical': BALL,
    'ball': BALL,
}  # fmt: skip
FREE = {'floating': 'floats', 'planar': 'slides in a plane'}
CLOSING = re.compile('closing|closed_?loop', re.IGNORECASE)  # what exporters name ends of loops
GRAVITY = 0.0, 0.0, -9.81  # m/s^2
KNOWN = {
    'link', 'joint', 'transmission', 'ros2_control', 'name_mot', 'joint_type', *CLOSURE_TAGS,
}  # fmt: skip


def read(robot: Node, source: str) -> Description:
    """A description from URDF.

    Args:
        robot: The element <robot>.
        source: What the file is called in messages.

    Raises:
        InputError: it is no valid URDF, or the robot has what this suite does not know.
    """
    links = {name: _link(node) for name, node in unique(children(robot, 'link')).items()}
    joints = unique(children(robot, 'joint'))
    kinds = _kinds_beyond_urdf(robot, joints)
    edges = [_edge(node, links, kinds.get(name)) for name, node in joints.items()]
    edges += _closing_edges(robot, links)
    actuators = _actuators(robot, joints)
    carried = {edge.child for edge in edges if edge.node.tag == 'joint'}
    roots = [name for name in links if name not in carried]
    if not links:
        raise InputError(f'{source} has no links')
    graph = built(source, list(links.values()), edges, roots, False, {a.joint for a in actuators})
    frames = {name: Frame(body) for name, body in graph.places.items()}
    ends = {edge.name: Frame(graph.places[edge.child]) for edge in edges} | frames
    return Description(
        source=source,
        bodies=tuple(graph.bodies),
        joints=tuple(graph.joints),
        loops=(*graph.loops, *_closing_frames(robot, ends)),
        couplings=(*_mimics(joints), *couplings(robot, edges)),
        tendons=(),
        actuators=tuple(actuators),
        frames=frames,
        keyframes={},
        gravity=np.array(GRAVITY),
        doubts=tuple(_doubts(robot, roots, links)),
    )


def _link(node: Node) -> Link:
    inertial = child(node, 'inertial')
    if inertial is None:
        return Link(name_of(node))
    frame, moments = origin(child(inertial, 'origin')), child(inertial, 'inertia')
    inertia = symmetric(np.array([number(moments, key) for key in MOMENTS]))
    mass = number(child(inertial, 'mass'), 'value')
    if mass < 0.0:
        raise refused(node, f'has a negative mass, {mass:g} kg')
    return Link(name_of(node), mass, frame.position, frame.rotation @ inertia @ frame.rotation.T)


def _edge(node: Node, links: dict[str, Link], steps: tuple[Joint, ...] | None) -> Edge:
    ends = []
    for tag in ('parent', 'child'):
        end = child(node, tag)
        if end is None:
            raise refused(node, f'has no {tag}')
        name = attribute(end, 'link')
        if name not in links:
            raise unknown(node, 'link', name)
        ends.append(name)
    if ends[0] == ends[1]:
        raise refused(node, f'joins the link {printable(ends[0])!r} with itself')
    at = origin(child(node, 'origin'))
    steps = (_step(node),) if steps is None else steps
    steps = tuple(step for step in steps if step.kind)
    return Edge(node, name_of(node), ends[0], ends[1], at, Frame(WORLD), steps)


def _step(node: Node) -> Joint:
    """The hinge, slide or ball of a joint; of a fixed one without a kind."""
    kind = attribute(node, 'type')
    if kind in FREE:
        raise refused(node, f'{FREE[kind]}; a robot must be fixed to the world')
    if kind not in KINDS:
        known = ', '.join(KINDS)
        raise refused(node, f'is of an unknown type {printable(kind)!r} (known: {known})')
    if not KINDS[kind]:
        return Joint('', WORLD, '', np.zeros(3))
    limit, dynamics = child(node, 'limit'), child(node, 'dynamics')
    limited = kind in ('revolute', 'prismatic')
    effort = number(limit, 'effort') or np.inf
    return Joint(
        name='',
        body=WORLD,
        kind=KINDS[kind],
        axis=unit(node, vector(child(node, 'axis'), 'xyz', (1.0, 0.0, 0.0))),
        lower=number(limit, 'lower', -np.inf) if limited else -np.inf,
        upper=number(limit, 'upper', np.inf) if limited else np.inf,
        effort=(-effort, effort),
        velocity=number(limit, 'velocity') or np.inf,
        damping=(number(dynamics, 'damping'),),
        coulomb=number(dynamics, 'friction'),
    )


def _mimics(joints: dict[str, Node]) -> list[Coupling]:
    """The joints that follow others."""
    found = []
    for name, node in joints.items():
        mimic = child(node, 'mimic')
        if mimic is None or node.get('type') == 'fixed':
            continue
        other = attribute(mimic, 'joint')
        if other not in joints or other == name:
            raise unknown(node, 'joint', other)
        ratio, offset = number(mimic, 'multiplier', 1.0), number(mimic, 'offset')
        found.append(Coupling(f'mimic of {name}', name, other, ratio, offset))
    return found


def _actuators(robot: Node, joints: dict[str, Node]) -> list[Actuator]:
    """What drives joints: name_mot, command interfaces and transmissions, or `independent`."""
    named = [(node, attribute(node, 'joint')) for node in children(robot, 'name_mot')]
    if not named:
        named = [
            (node, name_of(node))
            for parent in children(robot, 'transmission') + children(robot, 'ros2_control')
            for node in children(parent, 'joint')
            if parent.tag == 'transmission' or children(node, 'command_interface')
        ]
    if not named and any(node.get('independent') for node in joints.values()):
        named = [
            (node, name)
            for name, node in joints.items()
            if node.get('independent', 'true') == 'true' and node.get('type') != 'fixed'
        ]
    for node, name in named:
        if name not in joints:
            raise unknown(node, 'joint', name)
    following = {name for name, node in joints.items() if children(node, 'mimic')}
    still = {name for name, node in joints.items() if node.get('type') == 'fixed'}
    names = dict.fromkeys(name for _, name in named if name not in following | still)
    return [Actuator(name, name) for name in names]


def _doubts(robot: Node, roots: list[str], links: Collection[str]) -> list[str]:
    """What people should know of how the file was read."""
    doubts = []
    if len(roots) > 1:
        doubts.append(f'links without a parent are fixed to the world: {listed(roots)}')
    if tags := dict.fromkeys(f'<{node.tag}>' for node in children(robot) if node.tag not in KNOWN):
        doubts.append(f'unknown elements are left out: {listed(tags)}')
    ends = [name for name in links if CLOSING.search(name)]
    if ends and not any(children(robot, tag) for tag in CLOSURE_TAGS):
        doubts.append(f'nothing closes the loops that links are named after: {listed(ends)}')
    return doubts
