"""The tool of a machine whose user named none."""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np

from parallel_robot_model.common.errors import printable
from parallel_robot_model.mechanisms.description.assembly import Assembly, Equation, Tool
from parallel_robot_model.mechanisms.description.parts import (
    WORLD,
    Description,
    Frame,
    null_space,
    rank,
)
from parallel_robot_model.mechanisms.description.tree import Tree
from parallel_robot_model.mechanisms.mechanism import BASE, COUPLING, POINT

WORDS = (
    'tcp', 'tool', 'ee', 'eef', 'endeffector', 'end_effector', 'effector', 'attachment', 'flange',
    'platform', 'gripper', 'hand', 'tip', 'nacelle',
)  # fmt: skip


def guessed(description: Description, parts: Assembly, driven: list[int]) -> Tool:
    """The frame with the name of a tool, else the platform, else the end of the chain.

    Args:
        description: The robot.
        parts: Its links at home.
        driven: Links that are actuated.
    """
    tree = parts.tree
    closed = _tied(tree, [e for e in parts.equations if e.kind != COUPLING])
    moving = {*closed, *driven, *_tied(tree, parts.equations)}
    moved = {i for i in range(len(tree.links)) if moving.issuperset(_path(tree, i))}
    for word in WORDS:
        pattern = re.compile(rf'(?:^|[\W_\d]){word}(?:$|[\W_\d])', re.IGNORECASE)
        for name in sorted(description.frames, key=len):
            host = tree.on_link(description.frames[name])
            if host.body in moved and pattern.search(name):
                return Tool(name, host)
    if closed:
        return _platform(description, parts, driven)
    last = max(driven, key=lambda i: len(_path(tree, i)), default=BASE)
    return _origin(description, tree, last)


def _path(tree: Tree, link: int) -> list[int]:
    """The links from one to the base."""
    path = []
    while link != BASE:
        path.append(link)
        link = tree.links[link].parent
    return path


def _tied(tree: Tree, equations: list[Equation] | tuple[Equation, ...]) -> set[int]:
    """The links between what equations tie together."""
    return {
        link
        for equation in equations
        for link in {*_path(tree, equation.first.body)} ^ {*_path(tree, equation.second.body)}
    }


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
