"""Masses of the links of a tree: merged from bodies, checked, and felt at the actuated joints."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.assembly import Assembly, Inertia
from parallel_robot_model.mechanisms.description.parts import Body, Description, Frame, listed
from parallel_robot_model.mechanisms.description.tree import Freedoms, Tree, followed, place
from parallel_robot_model.mechanisms.mechanism import BASE

HEAVY, LIGHT = 1e4, 1e-6  # kg, beyond which a mass is doubtful
TINY = 1e-300  # kg, in place of no mass
SLACK = 1e-6  # of an inertia, relative, that rounding may cost
LEAST = 1e-12  # least eigenvalue of the inertia matrix, relative to the greatest


def merged(
    description: Description, tree: Tree, factor: float, load: float, tool: Frame
) -> Inertia:
    """The masses of all bodies on the links that carry them.

    Args:
        description: The robot.
        tree: Its links.
        factor: By which all masses and inertias are multiplied.
        load: A point of mass at the tool [kg].
        tool: The tool on its link.
    """
    count = len(tree.links)
    total = Inertia(np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3)))
    for body, host in zip(description.bodies, tree.hosts, strict=True):
        if host.body != BASE:
            centre = host.position + host.rotation @ body.centre
            turned = host.rotation @ body.inertia @ host.rotation.T
            _add(total, host.body, factor * body.mass, centre, factor * turned)
    if load and tool.body != BASE:
        _add(total, tool.body, load, tool.position, np.zeros((3, 3)))
    return total


def _add(total: Inertia, link: int, mass: float, centre: Array, inertia: Array) -> None:
    """Add a mass to those of a link."""
    whole = total.mass[link] + mass
    common = (total.mass[link] * total.centre[link] + mass * centre) / max(whole, TINY)
    total.inertia[link] += (
        inertia + _shift(mass, centre - common)
        + _shift(total.mass[link], total.centre[link] - common)
    )  # fmt: skip
    total.mass[link], total.centre[link] = whole, common


def _shift(mass: float, arm: Array) -> Array:
    return np.asarray(mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))


def doubtful(description: Description, tree: Tree) -> list[str]:
    """What is doubtful in the masses of bodies that move.

    Raises:
        InputError: a mass is negative, or an inertia is not positive.
    """
    moving = [
        body
        for body, host in zip(description.bodies, tree.hosts, strict=True)
        if host.body != BASE
    ]
    doubts = [doubt for body in moving for doubt in _doubts(description.source, body)]
    heavy = any(body.mass > 1000.0 * LIGHT for body in moving)
    dummies = [body.name for body in moving if heavy and 0.0 < body.mass < LIGHT]
    if dummies:
        doubts.append(f'bodies of less than {LIGHT:g} kg: {listed(dummies)}')
    return doubts


def _doubts(source: str, body: Body) -> list[str]:
    name = printable(body.name)
    if not (0.0 <= body.mass < np.inf and np.isfinite(body.inertia).all()):
        raise InputError(f'{source}: body {name!r}: mass={body.mass:g} must be finite, 0 or more')
    first, second, third = moments = np.linalg.eigvalsh(body.inertia)
    if first < -SLACK * max(abs(moments)):
        raise InputError(f'{source}: body {name!r}: its inertia has the moment {first:.3g} kg m^2')
    doubts = []
    if first + second < third * (1.0 - SLACK):
        doubts.append(
            f'body {name!r}: no body has moments of inertia of {first:.3g}, {second:.3g} and '
            f'{third:.3g} kg m^2: the greatest exceeds the sum of the others'
        )
    if body.mass > HEAVY:
        doubts.append(f'body {name!r} weighs {body.mass:.0f} kg')
    return doubts


def check_felt(source: str, parts: Assembly, freedoms: Freedoms, inertia: Inertia) -> None:
    """Refuse a machine with a motion that nothing with a mass takes part in.

    Raises:
        InputError: the inertia matrix is not positive definite.
    """
    matrix = felt(parts, freedoms, inertia)
    own = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scaled = matrix / np.outer(own, own) if own.all() else np.diag(own)
    sizes, motions = np.linalg.eigh(scaled)
    if sizes[0] <= LEAST:
        taking = np.abs(motions[:, 0]) > 0.1  # part in the motion
        names = (parts.tree.links[i].name for i in np.array(freedoms.actuated)[taking])
        raise InputError(
            f'{source}: nothing with a mass moves with joint {listed(names)}: the inertia matrix '
            'is not positive definite'
        )


def felt(parts: Assembly, freedoms: Freedoms, inertia: Inertia) -> Array:
    """Inertia matrix in the actuated joints at home [kg m^2 or kg], shape (n, n)."""
    places = place(parts.tree, parts.home)
    whole = np.diag([link.joint.armature for link in parts.tree.links])
    for i, mass in enumerate(inertia.mass):
        rate, turning = places.rates(Frame(i, position=inertia.centre[i]))
        turned = places.rotation[i] @ inertia.inertia[i] @ places.rotation[i].T
        whole = whole + mass * rate.T @ rate + turning.T @ turned @ turning
    motion = followed(parts.closures(scaled=False), freedoms)
    return np.asarray(motion.T @ whole @ motion)
