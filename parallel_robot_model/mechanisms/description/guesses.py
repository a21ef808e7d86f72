"""What is guessed of a machine, and what of its description is doubtful."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.assembly import Assembly, Equation, Tool
from parallel_robot_model.mechanisms.description.home import doubted
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    WORLD,
    Description,
    Frame,
    listed,
    null_space,
    rank,
)
from parallel_robot_model.mechanisms.description.tree import Freedoms, Tree
from parallel_robot_model.mechanisms.mechanism import BASE, COUPLING, HINGE, POINT

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


# What people should know of a home and of joints, and which homes are refused.

OPEN, TOLD = 1e-3, 1e-6  # what may stay open, and what is told, relative to the length
DEGREES = 10.0, 720.0  # rad, ends of travel that may be in degrees; of more turns there is no end
MILLIMETRES = 50.0, 1e5  # m, likewise in mm


def check_closed(source: str, parts: Assembly, closed: Array) -> None:
    """Refuse loops that no posture near home closes.

    Raises:
        InputError: they stay open.
    """
    left = parts.missed(closed)
    if left.max(initial=0.0) > OPEN * parts.length:
        worst = int(np.argmax(left))
        raise InputError(
            f'{source}: the loops do not close near home: '
            f'{printable(parts.equations[worst].name)!r} stays open by {left[worst]:.3g} m'
        )


def told(start: Assembly, closed: Array, parts: Assembly, freedoms: Freedoms) -> Iterator[str]:
    """What was decided about joints and home, one line each.

    Args:
        start: The machine at the home that was asked for, its loops perhaps open.
        closed: The positions there that close them [rad or m], shape (N,).
        parts: The machine at home.
        freedoms: Its joints.
    """
    links = parts.tree.links
    yield from _of_home(start, closed, parts)
    yield from doubted(parts, freedoms)
    joints = {links[i].joint.name: links[i].joint for i in freedoms.passive}.values()
    if rough := [f'{joint.name} ({joint.coulomb:.3g})' for joint in joints if joint.coulomb]:
        yield f'dry friction of passive joints [N m or N] is left out: {listed(rough)}'
    ends = {i: (links[i].joint.lower, links[i].joint.upper) for i in freedoms.actuated}
    if none := [links[i].name for i, (lower, upper) in ends.items() if lower >= upper]:
        yield f'travel without an extent is taken for none: {listed(none)}'
    yield from _of_units(parts, ends)
    single = [i for i in freedoms.passive if links[i].joint.kind != BALL]
    ends |= {i: (links[i].joint.lower, links[i].joint.upper) for i in single}
    out = [
        f'{links[i].name} at {parts.home[i]:.4g}'
        for i, (lower, upper) in ends.items()
        if lower < upper and not lower <= parts.home[i] <= upper
    ]
    if out:
        yield f'home is outside the travel of joints: {listed(out)}'


def _of_units(parts: Assembly, ends: Mapping[int, tuple[float, float]]) -> Iterator[str]:
    """Travel that looks like that of another unit."""
    for i, travel in ends.items():
        link, end = parts.tree.links[i], max(travel, key=abs)
        (least, most), unit, other, size = (
            (DEGREES, 'rad', 'degrees', np.pi / 180.0)
            if link.kind == HINGE
            else (MILLIMETRES, 'm', 'mm', 1e-3)
        )
        if least < abs(end) <= most:
            yield (
                f'travel of {printable(link.name)} ends at {end:.4g} {unit}: '
                f'if that is in {other}, it must be {end * size:.4g} {unit}'
            )


def _of_home(start: Assembly, closed: Array, parts: Assembly) -> Iterator[str]:
    """By how much home was closed, and what stays open."""
    if start.gap(start.home) > TOLD * parts.length:
        moved = np.abs(closed - start.home)
        turning = np.array([link.kind == HINGE for link in parts.tree.links])
        motions = (
            f'up to {moved[of].max():.3g} {unit}'
            for of, unit in ((turning, 'rad'), (~turning, 'm'))
            if moved[of].any()
        )
        yield (
            f'the loops were open by {start.distance(start.home):.3g} m at home; closed by '
            f'motions of {" and ".join(motions)}'
        )
    if (left := parts.gap(parts.home)) > TOLD * parts.length:
        yield f'closures that others imply stay open by {left:.3g} m'
