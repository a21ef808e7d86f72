"""What URDF and SDF have in common: numbers, links, joints, a tree of them, what is left out.

Whatever is wrong in a file raises InputError with its place.
"""

from __future__ import annotations

import difflib
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import IDLE, TEXT, Node, children, refused
from parallel_robot_model.mechanisms.description.parts import (
    INFINITY,
    WORLD,
    Body,
    Coupling,
    Description,
    Frame,
    Joint,
    Loop,
    held_by_loops,
    listed,
)
from parallel_robot_model.mechanisms.description.tree import compose
from parallel_robot_model.mechanisms.joint_kinds import OF_FILES

# Numbers, vectors and frames in the attributes (URDF) and elements (SDF) of XML.

MOMENTS = ('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz')
ZERO = (0.0, 0.0, 0.0)

Text = Callable[[Node | None, str], str | None]  # what an element says of a key, if anything
Notes = defaultdict[str, list[str]]  # names by what is to be known of them


def child(node: Node | None, tag: str) -> Node | None:
    """The first element of a kind in an element; others of it are left out."""
    if node is None:
        return None
    node.requested.add(tag)
    found = next((each for each in node if isinstance(each, Node) and each.tag == tag), None)
    if found is not None:
        found.used = True
    return found


def of_attribute(node: Node | None, key: str) -> str | None:
    """An attribute, where it is there."""
    return None if node is None else node.get(key)


def of_element(node: Node | None, key: str) -> str | None:
    """The text of an element in an element, where it is there."""
    found = child(node, key)
    if found is None:
        return None
    found.requested.add(TEXT)
    return (found.text or '').strip()


def name_of(node: Node) -> str:
    """The name of an element."""
    return attribute(node, 'name')


def attribute(node: Node, key: str) -> str:
    """An attribute that must be there."""
    value: str = node.get(key, '')
    if not value:
        raise refused(node, f'has no {key}')
    return value


def numbers(node: Node, text: str, what: str, count: int) -> Array:
    """Finite numbers in a text, shape (count,)."""
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.array([])
    if len(found) != count or not np.isfinite(found).all():
        wanted = 'a finite number' if count == 1 else f'{count} finite numbers'
        raise refused(node, f'{what}={printable(text.strip())!r} must be {wanted}')
    return found


def number(node: Node | None, key: str, default: float = 0.0, text: Text = of_attribute) -> float:
    """A number of an element; the default where that or the element is missing."""
    found = text(node, key) or ''
    if abs(default) == INFINITY and found.strip().lstrip('+-') in ('inf', 'infinity'):
        return float(found)  # a limit that is none
    return float(vector(node, key, (default,), text)[0])


def vector(
    node: Node | None, key: str, default: tuple[float, ...], text: Text = of_attribute
) -> Array:
    """Numbers of an element, as many as by default; those where it or they are missing."""
    found = text(node, key)
    if node is None or found is None:
        return np.array(default)
    own = [each for each in children(node) if each.tag == key]  # where it stands, or an attribute
    return numbers((own or [node])[0], found, key, len(default))


def unit(node: Node, axis: Array) -> Array:
    """An axis of length one."""
    largest = float(np.abs(axis).max())
    if not largest:
        raise refused(node, 'has an axis of zeros')
    axis = axis / largest
    return axis / np.linalg.norm(axis)


def rotation_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation about the fixed x, y and z axes, one after the other, shape (3, 3)."""
    if not (roll or pitch or yaw):
        return np.eye(3)
    return np.asarray(Rotation.from_euler('xyz', (roll, pitch, yaw)).as_matrix())


def of_quaternion(node: Node, quaternion: Array) -> Array:
    """Rotation of a quaternion x, y, z, w of about length one, shape (3, 3)."""
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > ROUNDED:
        raise refused(node, f'has a quaternion of length {length:.4g}, not 1')
    return np.asarray(Rotation.from_quat(quaternion).as_matrix())


def inverse(frame: Frame) -> Frame:
    """What a frame is seen from, seen from the frame."""
    back = frame.rotation.T
    return Frame(WORLD, back, -back @ frame.position)


def unique(nodes: list[Node]) -> dict[str, Node]:
    """Elements by name."""
    found: dict[str, Node] = {}
    for node in nodes:
        if (name := name_of(node)) in found:
            raise refused(node, 'stands twice')
        found[name] = node
    return found


def unknown(node: Node, kind: str, name: str) -> InputError:
    """The error that says that an element names what does not exist."""
    return refused(node, f'names an unknown {kind} {printable(name)!r}')


def is_true(text: str) -> bool:
    """Whether a flag is set."""
    return text.strip().lower() not in ('0', 'false')


def mark_used(node: Node | None) -> None:
    """Take all of an element for heard: it has no effect where it stands."""
    for each in () if node is None else node.iter():
        assert isinstance(each, Node)
        each.used = True
        each.requested |= {TEXT, *each.keys()}


def unused_elements(root: Node) -> Iterator[str]:
    """What of a description nothing asked for, one line for each kind of it with its places."""
    lines: defaultdict[str, list[int]] = defaultdict(list)
    waiting = [root]
    for node in waiting:  # it grows
        here = f'of <{node.tag}>'
        for key in node.attrib:
            if key not in (*node.requested, 'name') and not key.startswith('xmlns'):
                lines[f'{printable(key)} {here}{_near(key, node.requested)}'].append(node.line)
        if node.text and TEXT not in node.requested:
            lines[f'the text {here}'].append(node.line)
        for each in children(node):
            if each.used:
                waiting.append(each)
            elif each.tag not in IDLE:
                what = f'<{printable(each.tag)}> {here}{_near(str(each.tag), node.requested)}'
                what = f'another <{each.tag}> {here}' if each.tag in node.requested else what
                lines[what].append(each.line)
    for what, places in sorted(lines.items(), key=lambda item: item[1]):
        yield f'left out: {what}, line {listed(map(str, places))}'


def _near(word: str, known: Collection[str]) -> str:
    found = difflib.get_close_matches(word, known, n=1, cutoff=0.75)
    return f' (did you mean {found[0]}?)' if found else ''


# Links and joints.

ROUNDED = 1e-3  # by which the length of a quaternion may differ from one
AXES = np.eye(3)
ENDINGS = (), ('',), ('.1', '.2'), ('.px', '.py', ''), ('.px', '.py', '.pz', '')  # of names


class Edge(NamedTuple):
    """A joint between two links."""

    node: Node  # its element
    name: str
    parent: str  # name of a link
    child: str  # name of the other
    at: Frame  # its frame on the parent
    on_child: Frame  # the same frame on the child, at zero
    # its hinges, slides or a ball one after the other from the parent on, with axes in its
    # frame; empty: fixed. Their `name` is the end of a name, or empty; `body` is unset
    steps: tuple[Joint, ...]


def link(
    node: Node,
    inertial: Node | None,
    frame: Frame,
    mass: float,
    text: Text,
    default: float,
    weightless: bool,
) -> Body:
    """A link before it has a place."""
    if mass < 0.0:
        raise refused(node, f'has a negative mass, {mass:g} kg')
    moments = child(inertial, 'inertia')
    xx, yy, zz, xy, xz, yz = (
        number(moments, key, default if key[1] == key[2] else 0.0, text) for key in MOMENTS
    )
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(
        name_of(node), WORLD, np.eye(3), np.zeros(3), mass, frame.position,
        frame.rotation @ inertia @ frame.rotation.T, float(weightless),
    )  # fmt: skip


def steps(node: Node, kind: str, axes: Sequence[Array]) -> tuple[Joint, ...]:
    """The hinges, slides and balls of a joint."""
    if kind not in OF_FILES:
        known = ', '.join(OF_FILES)
        raise refused(node, f'is of an unknown type {printable(kind)!r} (known: {known})')
    kinds = OF_FILES[kind]
    if kind == 'planar' and len(axes):
        normal = unit(node, axes[0])
        second = np.cross(normal, AXES[np.argmin(np.abs(normal))])
        second /= np.linalg.norm(second)
        axes = np.cross(second, normal), second, normal
    if kinds and not kinds[-1].single:
        axes = [*AXES[: len(kinds) - 1], AXES[2]]
    if len(axes) < len(kinds):
        raise refused(node, 'has one axis, and needs two' if len(axes) else 'has no axis')
    return tuple(
        Joint(name, WORLD, of, unit(node, np.asarray(axis)))
        for name, of, axis in zip(ENDINGS[len(kinds)], kinds, axes, strict=False)
    )


def with_limits(
    step: Joint, name: str, limit: Node | None, dynamics: Node | None, text: Text, notes: Notes
) -> Joint:
    """A hinge or slide with its friction, and its limits of effort and speed."""
    urdf, greatest = text is of_attribute, []
    for key in ('effort', 'velocity'):
        value = number(limit, key, INFINITY, text)
        none = value in (0.0, -1.0) or (value < 0.0 and not urdf)
        if value == 0.0 or (none and urdf):
            notes[f'{key}={value:g} is taken for no limit'].append(name)
        elif value < 0.0 and urdf:  # the magnitude of what it limits is below that of the limit
            notes[f'{key}={value:g} is taken for {-value:g}'].append(name)
        greatest.append(INFINITY if none else abs(value))
    effort, velocity = greatest
    stiffness = 0.0 if urdf else number(dynamics, 'spring_stiffness', 0.0, text)
    return step._replace(
        effort=(-effort, effort),
        velocity=velocity,
        damping=(number(dynamics, 'damping', 0.0, text),),
        coulomb=number(dynamics, 'friction', 0.0, text),
        stiffness=(stiffness,) if stiffness else (),
        rest=0.0 if urdf else number(dynamics, 'spring_reference', 0.0, text),
    )


def followers(joints: dict[str, Node], text: Text) -> list[Coupling]:
    """The joints that follow others: position = ratio (other - reference) + offset."""
    found = []
    for name, node in joints.items():
        mimic, how = child(node if text is of_attribute else child(node, 'axis'), 'mimic'), text
        if mimic is None:
            mimic, how = child(node, 'drake:mimic'), of_attribute
        if mimic is None or not OF_FILES.get(node.get('type')):
            continue
        other = attribute(mimic, 'joint')
        if other not in joints or other == name:
            raise unknown(node, 'joint', other)
        ratio, offset = number(mimic, 'multiplier', 1.0, how), number(mimic, 'offset', 0.0, how)
        if how is of_element:
            offset -= ratio * number(mimic, 'reference', 0.0, how)
        found.append(Coupling(f'mimic of {name}', name, other, ratio, offset))
    return found


def check_held(description: Description, edges: Sequence[Edge]) -> None:
    """Refuse a link that has all freedoms, or those of a plane, and that no loop holds."""
    held = held_by_loops(description)
    for edge in edges:
        if len(edge.steps) > 2 and description.frames[edge.child].body not in held:
            what = 'floats' if not edge.steps[-1].kind.single else 'slides in a plane'
            raise refused(
                edge.node, f'{what}, and no loop holds it; a robot must be fixed to the world'
            )


# A tree spread over links and joints; the joints that are left close its loops.

MOST = 1000  # links
LEVER = 0.1  # m, between two points that keep an axis


def build_description(
    source: str,
    links: Sequence[Body],
    edges: Sequence[Edge],
    fixed: Sequence[str],
    both_ways: bool,
    driven: Collection[str] = (),
    closing: Sequence[Edge] = (),
) -> Description:
    """The bodies, joints, loops and frames that links and joints make; no more is known yet."""
    if not links:
        raise InputError(f'{source} has no links')
    if len(links) > MOST:
        raise InputError(f'{source} has {len(links)} links; {MOST} are possible')
    growing = _Growing()
    by_name = {each.name: each for each in links}
    for name in fixed:
        growing.add(by_name[name], Frame(WORLD))
    reached, waiting = list(fixed), list(edges)
    for name in reached:  # it grows
        for edge in [edge for edge in waiting if name in (edge.parent, edge.child)]:
            way = edge if name == edge.parent else _reversed(edge) if both_ways else None
            if way is None:
                continue
            waiting.remove(edge)
            if way.child in growing.frames:
                growing.close(edge, driven)
            else:
                growing.carry(by_name[way.child], way)
                reached.append(way.child)
    if left := [each.name for each in links if each.name not in growing.frames]:
        what = (
            'that no joints join to the world'
            if both_ways
            else 'that carry each other in a circle'
        )
        raise InputError(f'{source}: links {what}: {listed(left)}')
    for edge in closing:
        growing.close(edge, driven)
    nothing = np.zeros(3)
    return Description(
        source, tuple(growing.bodies), tuple(growing.joints), tuple(growing.loops),
        (), (), (), growing.frames, {}, nothing, (),
    )  # fmt: skip


class _Growing:
    """Bodies, joints and loops so far, and the frames of links by name."""

    def __init__(self) -> None:
        self.bodies: list[Body] = []
        self.joints: list[Joint] = []
        self.loops: list[Loop] = []
        self.frames: dict[str, Frame] = {}

    def add(self, link: Body, at: Frame) -> Frame:
        frame = Frame(len(self.bodies))
        self.frames[link.name] = frame
        placed = link._replace(parent=at.body, rotation=at.rotation, position=at.position)
        self.bodies.append(placed)
        return frame

    def carry(self, link: Body, edge: Edge) -> Frame:
        """Add a link that hangs on a joint."""
        frame = self.add(
            link, compose(compose(self.frames[edge.parent], edge.at), inverse(edge.on_child))
        )
        for step in edge.steps:
            self.joints.append(
                step._replace(
                    name=edge.name + step.name,
                    body=frame.body,
                    axis=edge.on_child.rotation @ step.axis,
                    anchor=edge.on_child.position,
                )
            )
        return frame

    def close(self, edge: Edge, driven: Collection[str]) -> None:
        """Close a loop with a joint."""
        first = compose(self.frames[edge.parent], edge.at)
        second = compose(self.frames[edge.child], edge.on_child)
        steps, last = edge.steps[:-1], edge.steps[-1:]
        if edge.name in driven or (last and last[0].kind.slides):
            steps, last = edge.steps, ()
        if steps:  # what the loop cannot say is a joint of a body without mass
            own = Body(f'{edge.name} (end)', WORLD, np.eye(3), np.zeros(3))
            first = self.carry(own, edge._replace(on_child=Frame(WORLD), steps=steps))
        if last and last[0].kind.single:
            for arm in (np.zeros(3), LEVER * last[0].axis):
                lever = Frame(WORLD, position=arm)
                ends = compose(first, lever), compose(second, lever)
                self.loops.append(Loop(edge.name, ends[0], ends[1], False))
        else:
            self.loops.append(Loop(edge.name, first, second, not last))


def _reversed(edge: Edge) -> Edge:
    """The same joint, the parent on the child; positions of hinges and slides keep their sign."""
    steps = tuple(step._replace(axis=-step.axis) for step in reversed(edge.steps))
    return edge._replace(
        parent=edge.child, child=edge.parent, at=edge.on_child, on_child=edge.at, steps=steps
    )
