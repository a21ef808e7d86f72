"""What closes loops in URDF, of several authors.

Sources:
    `constraint`: pull requests ros/urdfdom_headers#108 and ros/urdfdom#264 (2026): joints of
    which both ends have an origin. `loop` and `coupling`: Chignoli, Slotine, Wensing, Kim (2024),
    URDF+, arXiv 2411.19753. `closed_loop`: see `configuration.robot_loops`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from parallel_robot_model.common.errors import printable
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.graph import (
    Edge,
    attribute,
    child,
    name_of,
    number,
    origin,
    unit,
    unknown,
    vector,
)
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    HINGE,
    SLIDE,
    WORLD,
    Coupling,
    Frame,
    Joint,
    Loop,
)

TAGS = 'constraint', 'loop', 'coupling', 'closed_loop'
AXES = {'X': (1.0, 0.0, 0.0), 'Y': (0.0, 1.0, 0.0), 'Z': (0.0, 0.0, 1.0)}
KINDS = {
    'revolute': HINGE, 'continuous': HINGE, 'prismatic': SLIDE, 'spherical': BALL, 'ball': BALL,
    'fixed': '', 'link': '',
}  # fmt: skip
ENDS = {'constraint': ('parent', 'child'), 'loop': ('predecessor', 'successor')}


def kinds(robot: Node, joints: Collection[str]) -> dict[str, tuple[Joint, ...]]:
    """The joints that are of another kind than URDF can say.

    Raises:
        InputError: a joint or a kind is unknown.
    """
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


def edges(robot: Node, links: Collection[str]) -> list[Edge]:
    """The joints that close loops.

    Raises:
        InputError: a link or a kind is unknown.
    """
    return [_edge(node, links) for tag in ENDS for node in children(robot, tag)]


def _edge(node: Node, links: Collection[str]) -> Edge:
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
    if not KINDS.get(kind, kind):
        return ()
    axes = [unit(node, vector(child(node, key), 'xyz', (1.0, 0.0, 0.0))) for key in keys]
    if kind == 'universal' and len(axes) == 2:
        return tuple(Joint(f'.{i}', WORLD, HINGE, axis) for i, axis in enumerate(axes, 1))
    if kind not in KINDS:
        known = ', '.join(KINDS)
        raise refused(node, f'is of an unknown type {printable(kind)!r} (known: {known})')
    return (Joint('', WORLD, KINDS[kind], axes[0]),)


def loops(robot: Node, frames: Mapping[str, Frame]) -> list[Loop]:
    """The pairs of frames that coincide.

    Raises:
        InputError: a frame or a kind is unknown.
    """
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
