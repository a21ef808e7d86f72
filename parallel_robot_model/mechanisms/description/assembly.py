"""A tree with its loops and its tool, as numbers in one unit and as a mechanism."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import UnknownNameError, printable
from parallel_robot_model.common.units import Array, rounded
from parallel_robot_model.mechanisms.description.parts import (
    UNLIMITED,
    WORLD,
    Description,
    Frame,
    Joint,
    Tendon,
    null_space,
    rank,
)
from parallel_robot_model.mechanisms.description.tree import (
    AXES,
    Freedoms,
    LinkFrames,
    Posture,
    Tree,
    link_frames,
    rotation_about,
)
from parallel_robot_model.mechanisms.mechanism import (
    BASE,
    COUPLING,
    FIRST,
    LAST,
    ORIENTATION,
    POINT,
    WHOLE,
    Elements,
    Index,
    Mechanism,
    elements,
)

# The equations that close the loops of a tree, and how well a posture meets them.


class Equation(NamedTuple):
    """A scalar equation that closes a loop."""

    name: str  # of the loop or the coupling
    kind: int  # POINT, TURN or COUPLING
    first: Frame  # a frame of a link; of a COUPLING the link alone counts
    second: Frame  # the other
    direction: Array = np.zeros(3)  # which component, a unit vector of the world, shape (3,)
    ratio: float = 0.0  # of a COUPLING
    offset: float = 0.0  # of a COUPLING [rad or m]


def equations(description: Description, tree: Tree) -> tuple[Equation, ...]:
    """All equations of the loops and couplings of a description, redundant ones, too."""
    found = [
        Equation(loop.name, kind, tree.on_link(loop.first), tree.on_link(loop.second), direction)
        for loop in description.loops
        for kind in ((POINT, ORIENTATION) if loop.turns else (POINT,))
        for direction in np.eye(3)
    ]
    index = {link.name: Frame(i) for i, link in enumerate(tree.links)} | {'': Frame(BASE)}
    for name, joint, other, ratio, offset in description.couplings:
        ends = index[joint], index[other]
        found.append(Equation(name, COUPLING, *ends, ratio=ratio, offset=offset))
    return tuple(found)


def residuals(equations: tuple[Equation, ...], frames: LinkFrames, q: Array) -> Array:
    """By how much a posture misses each equation [m or rad], shape (R,)."""
    missed = []
    for _, kind, first, second, direction, ratio, offset in equations:
        if kind == COUPLING:
            other = 0.0 if second.body == BASE else q[second.body]
            missed.append(q[first.body] - offset - ratio * other)
            continue
        rotation, point = frames.frame(first)
        other_rotation, other_point = frames.frame(second)
        if kind == POINT:
            missed.append(direction @ (point - other_point))
        else:
            turned = Rotation.from_matrix(rotation @ other_rotation.T)
            missed.append(direction @ turned.as_rotvec())
    return np.array(missed)


def jacobian(equations: tuple[Equation, ...], frames: LinkFrames) -> Array:
    """Derivative of the residuals by the positions where the equations are met, shape (R, N)."""
    rows = np.zeros((len(equations), len(frames.axis)))
    for row, (_, kind, first, second, direction, ratio, _) in zip(rows, equations, strict=True):
        if kind == COUPLING:
            row[first.body] = 1.0
            if second.body != BASE:
                row[second.body] -= ratio
            continue
        one, other = frames.rates(first), frames.rates(second)
        row[:] = direction @ (one[kind != POINT] - other[kind != POINT])
    return rows


# What a machine moves: a frame of the description, and coordinates for its motion.

NAMES, UNITS = ('x', 'y', 'z', 'rx', 'ry', 'rz'), ('m',) * 3 + ('rad',) * 3
ORDER = (0, 1, 2, 5, 4, 3)  # in which coordinates are taken
INDEPENDENCE = (
    0.02,
    1e-4,
)  # what makes a coordinate independent of those before, tried in this order


class Tool(NamedTuple):
    """The frame that is controlled."""

    name: str  # its name, or what it is
    frame: Frame  # on its link


def named(description: Description, tree: Tree, name: str) -> Tool:
    """The frame of a name.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in description.frames:
        raise UnknownNameError('site, body or link', name, description.frames)
    return Tool(name, tree.on_link(description.frames[name]))


# two axes, and the rotation about their normal
NORMALS: dict[tuple[int, ...], int] = {(0, 1): 5, (0, 2): 4, (1, 2): 3}


def coordinates(motion: Array) -> tuple[tuple[int, ...], tuple[tuple[str, str], ...], bool]:
    """The coordinates that describe where the tool is, where there are as many as freedoms.

    Args:
        motion: Rate of the tool and its angular rate, in one unit, by the n actuated joints,
            shape (6, n).

    Returns:
        Indices, 0 to 2 for x, y, z, 3 to 5 for the rotation, and names with units; both empty if
        the tool does not have n independent motions. Whether it moves in the plane of the first
        two, which are lengths then.
    """
    size = float(np.linalg.norm(motion, 2)) if motion.size else 0.0
    count = motion.shape[1]
    for apart in INDEPENDENCE if size else ():
        chosen: list[int] = []
        for i in ORDER:
            if len(chosen) < count and _distance(motion[i], motion[chosen]) > apart * size:
                chosen.append(i)
        if len(chosen) == count:
            chosen.sort()
            pair = tuple(chosen[:2])
            axes = *pair, NORMALS.get(pair, -1)
            beside = np.abs(np.delete(motion, axes, axis=0)).max()
            plane = pair in NORMALS and [*axes[: len(chosen)]] == chosen
            plane = plane and bool(beside < INDEPENDENCE[1] * size)
            level = plane and pair == (0, 1)
            names = ['phi' if level and i == 5 else NAMES[i] for i in chosen]
            units = (UNITS[i] for i in chosen)
            planar = plane or chosen == [0, 1]
            return tuple(chosen), tuple(zip(names, units, strict=True)), planar
    return (), (), False


def _distance(row: Array, rows: Array) -> float:
    """Distance of a row from the space of others."""
    if not len(rows):
        return float(np.linalg.norm(row))
    left = row - np.linalg.lstsq(rows.T, row, rcond=None)[0] @ rows
    return float(np.linalg.norm(left))


class Assembly(NamedTuple):
    """A tree, what closes it and what it moves."""

    tree: Tree  # the links
    equations: tuple[Equation, ...]  # what closes their loops, redundant ones, too
    tool: Tool  # what is controlled
    home: Array  # positions of the links [rad or m], shape (N,)
    length: float  # by which angles and lengths are compared [m]
    unit: Array  # what makes each residual a length [1 or rad/m], shape (R,)

    def residuals(self, q: Array) -> Array:
        """By how much positions miss each equation [m], angles times the length, shape (R,)."""
        return np.abs(residuals(self.equations, link_frames(self.tree, q), q) / self.unit)

    def gap(self, q: Array) -> float:
        """The greatest of them."""
        return float(self.residuals(q).max(initial=0.0))

    def distance(self, q: Array) -> float:
        """The greatest distance of what should coincide [m]."""
        points = np.array([equation.kind == POINT for equation in self.equations], dtype=bool)
        return float(self.residuals(q)[points].max(initial=0.0))

    def closures(self, scaled: bool = True) -> Array:
        """Derivative of the equations by the positions at home, shape (R, N).

        Args:
            scaled: Whether lengths count as angles; else the positions have their units.
        """
        matrix = jacobian(self.equations, link_frames(self.tree, self.home)) / self.unit[:, None]
        return matrix / self.length * self.steps if scaled else matrix

    def motion_of(self, frame: Frame) -> Array:
        """Motion of a frame of a link at home, lengths counted as angles, shape (6, N)."""
        rate, turning = link_frames(self.tree, self.home).rates(frame)
        return np.vstack([rate / self.length, turning]) * self.steps

    @property
    def steps(self) -> Array:
        """What moves points of the machine by about its length, by joint, shape (N,)."""
        return np.array([1.0 if link.kind.turns else self.length for link in self.tree.links])


# The tool of a machine whose user named none.

WORDS = (
    'tcp', 'tool', 'ee', 'eef', 'endeffector', 'end_effector', 'effector', 'attachment', 'flange',
    'platform', 'gripper', 'hand', 'tip', 'fingertip', 'endpoint', 'nozzle', 'nacelle',
)  # fmt: skip


def guessed(description: Description, parts: Assembly, driven: list[int]) -> Tool:
    """The frame with the name of a tool, else the platform, else the end of the chain.

    The end is the only frame that is fixed to its last link away from the joint, if there is one.

    Args:
        description: The robot.
        parts: Its links at home.
        driven: Links that are actuated.
    """
    tree = parts.tree
    closed = _tied(tree, [e for e in parts.equations if e.kind != COUPLING])
    moving = {*closed, *driven, *_tied(tree, parts.equations)}
    moved = {i for i in range(len(tree.links)) if moving.issuperset(tree.path(i))}
    for word in WORDS:
        pattern = re.compile(rf'(?:^|[\W_\d]){word}(?:$|[\W_\d])', re.IGNORECASE)
        for name in sorted(description.frames, key=len):
            host = tree.on_link(description.frames[name])
            if host.body in moved and pattern.search(name):
                return Tool(name, host)
    if closed:
        return _platform(description, parts, driven)
    last = max(driven, key=lambda i: len(tree.path(i)), default=BASE)
    hosts = {name: tree.on_link(frame) for name, frame in description.frames.items()}
    away = [name for name, host in hosts.items() if host.body == last and host.position.any()]
    return Tool(away[0], hosts[away[0]]) if len(away) == 1 else _origin(description, tree, last)


def _tied(tree: Tree, equations: list[Equation] | tuple[Equation, ...]) -> set[int]:
    """The links between what equations tie together."""
    ends = ((each.first.body, each.second.body) for each in equations)
    return {i for a, b in ends for i in {*tree.path(a)} ^ {*tree.path(b)}}


def _platform(description: Description, parts: Assembly, driven: list[int]) -> Tool:
    """The body with most freedoms; of several, where most chains meet, or a point of two."""
    tree, free = parts.tree, null_space(parts.closures())
    motion = free @ np.linalg.pinv(free[driven])
    last = {link.body: i for i, link in enumerate(tree.links)}  # the last link of each body
    freedoms = {body: rank(parts.motion_of(Frame(i)) @ motion) for body, i in last.items()}
    best = [body for body, count in freedoms.items() if count == max(freedoms.values())]
    neighbours = _neighbours(parts)
    far = _far(neighbours)
    body = max(best, key=lambda body: (len(neighbours[body]), far[body]))
    points = [e for e in parts.equations if e.kind == POINT]
    if len(best) > 1 and len(neighbours[body]) <= 2 and points:
        first, second = points[0].first, points[0].second
        point = first if first.body != BASE else second
        return Tool(f'the point of {printable(points[0].name)}', point)
    return _origin(description, tree, last[body])


def _neighbours(parts: Assembly) -> dict[int, set[tuple[str, int]]]:
    """The bodies that joints and loops tie to each body, or to WORLD, with their names."""
    links = parts.tree.links
    pairs = [
        (equation.name, equation.first.body, equation.second.body)
        for equation in parts.equations
        if equation.kind != COUPLING
    ]
    pairs += [(link.joint.name, i, link.parent) for i, link in enumerate(links)]
    found: dict[int, set[tuple[str, int]]] = defaultdict(set)
    for name, *ends in pairs:
        first, second = (links[i].body if i != BASE else WORLD for i in ends)
        if first != second:
            found[first].add((name, second))
            found[second].add((name, first))
    return found


def _far(neighbours: dict[int, set[tuple[str, int]]]) -> dict[int, int]:
    """How many joints and loops there are between each body and the world."""
    far, reached = {WORLD: 0}, [WORLD]
    for body in reached:  # it grows
        for _, other in sorted(neighbours[body]):
            if other not in far:
                far[other] = far[body] + 1
                reached.append(other)
    return far


def _origin(description: Description, tree: Tree, link: int) -> Tool:
    """The body of a link, at its origin."""
    if link == BASE:
        return Tool('the base', Frame(BASE))
    body = tree.links[link].body
    return Tool(description.bodies[body].name, tree.on_link(Frame(body)))


# A tree with its loops, ready to be moved; what it weighs.


class Inertia(NamedTuple):
    """Masses of the N links."""

    mass: Array  # masses [kg], shape (N,)
    centre: Array  # centres of mass in the frames of the links [m], shape (N, 3)
    inertia: Array  # about them in these frames [kg m^2], shape (N, 3, 3)


TURNING_RATE = 1e-3  # relative rate of a body above which it turns


def with_spins(parts: Assembly, freedoms: Freedoms) -> Assembly:
    """The same, where a hinge of a ball with a rotor is that about which its rod may spin.

    It is the last hinge where the ball carries the rod, else the first.
    """
    places = link_frames(parts.tree, parts.home)
    links = list(parts.tree.links)
    free = [i for i in range(len(links)) if i not in freedoms.actuated]
    motion = np.zeros((len(links), 0))
    if freedoms.held:
        null = null_space(parts.closures()[:, free])
        motion = np.zeros((len(links), null.shape[1]))
        motion[free] = null
    for i, link in enumerate(links):
        if link.joint.kind.single or not link.joint.armature or not link.name.endswith(AXES[0]):
            continue
        if rank(motion[i : i + 3]) == 1:
            spin = np.linalg.svd(motion[i : i + 3])[0][:, 0]
            spin *= np.sign(spin[np.argmax(np.abs(spin))])
            across = np.cross(np.eye(3)[np.argmin(np.abs(spin))], spin)
            across /= np.linalg.norm(across)
            carried = places.rates(Frame(i + 2))[1] @ motion
            last = bool(np.abs(carried).max() > TURNING_RATE * np.abs(motion[i : i + 3]).max())
            axes = (across, np.cross(spin, across), spin)
            for step, axis in enumerate(axes if last else np.roll(axes, 1, axis=0)):
                side = LAST if last else FIRST
                links[i + step] = links[i + step]._replace(axis=axis, spins=side)
    return parts._replace(tree=parts.tree._replace(links=tuple(links)))


def assembled(description: Description, tree: Tree, at: Posture) -> Assembly:
    """A tree in a posture, its loops still open, without a tool.

    Args:
        description: The robot.
        tree: Its links.
        at: Positions of its joints.
    """
    closing = equations(description, tree)
    values = (at[link.joint.name] if link.joint.kind.single else 0.0 for link in tree.links)
    home = np.array([value for value in values if not isinstance(value, tuple)])
    length = _length(tree, closing, home)
    slides = [e.kind == COUPLING and not tree.links[e.first.body].kind.turns for e in closing]
    lengths = (slide or e.kind == POINT for slide, e in zip(slides, closing, strict=True))
    unit = [1.0 if each else 1.0 / length for each in lengths]
    return Assembly(tree, closing, Tool('', Frame(BASE)), home, length, np.array(unit))


def rebased(parts: Assembly, closed: Array) -> Assembly:
    """The same at home in a posture, where all balls are at zero, their hinges orthogonal."""
    links, home = list(parts.tree.links), closed.copy()
    for i, link in enumerate(links):
        if not link.joint.kind.single and link.name.endswith(AXES[0]):
            turned = link.rotation
            for step in range(3):
                turned = turned @ rotation_about(links[i + step].axis, closed[i + step])
            links[i] = link._replace(rotation=turned)
            home[i : i + 3] = 0.0
    return parts._replace(tree=parts.tree._replace(links=tuple(links)), home=home)


def _length(tree: Tree, closing: tuple[Equation, ...], home: Array) -> float:
    """The greatest distance of joints and loops from their middle [m], two digits."""
    places = link_frames(tree, home)
    frames = [frame for e in closing if e.kind == POINT for frame in (e.first, e.second)]
    points = [*places.position, *(places.frame(frame)[1] for frame in frames)]
    spread = np.linalg.norm(np.array(points) - np.mean(points, axis=0), axis=1).max()
    return rounded(spread, 2) or 1.0


def as_mechanism(
    description: Description,
    parts: Assembly,
    freedoms: Freedoms,
    inertia: Inertia,
    coordinate: tuple[int, ...],
    factor: float,
) -> Mechanism:
    """The value that kernels take; `factor` is that of all masses."""
    links = parts.tree.links
    chosen = [parts.equations[i] for i in freedoms.rows]
    tool = parts.tool.frame
    turned = [
        e.first.rotation @ e.second.rotation.T if e.kind == ORIENTATION else np.eye(3)
        for e in chosen
    ]
    return Mechanism(
        parent=_index(link.parent for link in links),
        turns=_array(link.kind.turns for link in links),
        slides=_array(link.kind.slides for link in links),
        rotation=_array((link.rotation for link in links), 3, 3),
        origin=_array((link.origin for link in links), 3),
        axis=_array((link.axis for link in links), 3),
        mass=inertia.mass,
        centre=inertia.centre,
        inertia=inertia.inertia,
        armature=_array(link.joint.armature if link.joint.kind.single else 0.0 for link in links),
        gravity=np.array(description.gravity, dtype=float),
        elements=_elements(description, parts, freedoms, factor),
        closure=_index(e.kind for e in chosen),
        first=_index(e.first.body for e in chosen),
        second=_index(e.second.body for e in chosen),
        first_point=_array((e.first.position for e in chosen), 3),
        second_point=_array((e.second.position for e in chosen), 3),
        relative_rotation=_array(turned, 3, 3),
        direction=_array((e.direction for e in chosen), 3),
        ratio=_array(e.ratio for e in chosen),
        offset=_array(e.offset for e in chosen),
        actuated=_index(freedoms.actuated),
        passive=_index(freedoms.passive),
        home=parts.home,
        tool=tool.body,
        tool_point=np.array(tool.position),
        tool_rotation=np.array(tool.rotation),
        tool_home=link_frames(parts.tree, parts.home).frame(tool)[0],
        coordinate=_index(coordinate),
        length=parts.length,
    )


def _elements(
    description: Description, parts: Assembly, freedoms: Freedoms, factor: float
) -> Elements:
    """Springs, dampers, rotors and lifts; travel of joints that are not actuated."""
    links, N = parts.tree.links, len(parts.tree.links)
    tendons = [
        *(_joint_tendon(link.joint, i in freedoms.actuated) for i, link in enumerate(links)
          if i not in freedoms.held and link.joint.kind.single),
        *description.tendons,
    ]  # fmt: skip
    tendons = [each for each in tendons if _has_effect(each)]
    found = elements(N, len(tendons))
    index = {link.name: i for i, link in enumerate(links)}
    for k, tendon in enumerate(tendons):
        for name, ratio in tendon.ratios.items():
            found.ratio[k, index[name]] = ratio
        found.rest[k], found.armature[k] = tendon.rest, tendon.armature
        found.stiffness[k, : len(tendon.stiffness)] = tendon.stiffness
        found.damping[k, : len(tendon.damping)] = tendon.damping
        found.travel[k] = tendon.lower, tendon.upper
    for i, link in enumerate(links):
        if not link.joint.kind.single and link.name.endswith(AXES[-1]):
            rotor, other = link.joint.armature, links[i - 2].parent
            found.ball[i, link.spins] = rotor
            if link.spins == FIRST and other != BASE and links[other].spins == LAST:
                both = rotor * links[other].joint.armature / (rotor + links[other].joint.armature)
                found.ball[i, [WHOLE, FIRST]] = both, rotor - both
    for body, host in zip(description.bodies, parts.tree.hosts, strict=True):
        if body.lifted and host.body != BASE:
            i, mass = host.body, factor * body.mass * body.lifted
            centre, whole = host.position + host.rotation @ body.centre, found.lifted[i] + mass
            found.lifted_at[i] += (centre - found.lifted_at[i]) * (mass / whole if whole else 0.0)
            found.lifted[i] = whole
    return found


def _has_effect(tendon: Tendon) -> bool:
    """Whether it does anything but rub."""
    ends = np.isfinite([tendon.lower, tendon.upper])
    return any((*tendon.damping, *tendon.stiffness, tendon.armature, *ends))


def _joint_tendon(joint: Joint, actuated: bool) -> Tendon:
    """What acts in a joint, as a tendon; the linear friction of actuated ones is the plant's."""
    damping = (0.0, *joint.damping[1:]) if actuated else joint.damping
    ends = UNLIMITED if actuated or joint.lower >= joint.upper else (joint.lower, joint.upper)
    return Tendon(
        joint.name, {joint.name: 1.0}, *ends, damping=damping, stiffness=joint.stiffness,
        rest=(joint.rest, joint.rest),
    )  # fmt: skip


def _index(values: Iterable[int]) -> Index:
    return np.array(list(values), dtype=np.int64)


def _array(values: Iterable[Any], *shape: int) -> Array:
    return np.array(list(values), dtype=float).reshape(-1, *shape)
