"""Links, rotors and the payload of a described machine as bodies, and as its parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.robots.contract import Bodies, KnownQuantity, amount, within
from parallel_robot_model.robots.described import masses
from parallel_robot_model.robots.described.parameters import Parameters

LEAST = 1e-3  # of the length of the machine, the least width of a body
WIDE = np.array([0.1, 10.0])  # of the mass in the file, what is assumed of the machine's


class NumberIndices(NamedTuple):
    """Where the free numbers of a machine stand in its parameters p, by number of their joint."""

    links: dict[int, list[int]]  # six moments, three of the centre and the mass; or the moments
    rotors: dict[int, int]


def bodies(
    made: Machine, robot: Parameters, places: NumberIndices, p: Array, by_payload: Array | None
) -> Bodies:
    """The bodies; a link without the payload.

    A link whose numbers are those of no body, or of one without a width, has those of a body near
    it.

    Args:
        made: The machine.
        robot: Its parameters.
        places: Where its free numbers stand.
        p: Parameters of its linear model, shape (P,).
        by_payload: Their derivatives by the payload, shape (P,); None if there is none.
    """
    free = [*(k for each in places.links.values() for k in each), *places.rotors.values()]
    count = len(free) + (by_payload is not None)
    row, linear, numbers = np.eye(count), np.zeros((len(p), count)), np.zeros(count)
    linear[free, np.arange(len(free))] = 1.0
    found = masses.masses(made.mechanism, robot._replace(payload=0.0))
    blocks: list[Array] = []
    known: dict[str, KnownQuantity] = {}
    total, first, length = np.zeros(count), 0, made.mechanism.length
    for i, place in places.links.items():
        own = row[first : first + len(place)]
        numbers[first : first + len(place)] = _possible(found, i, LEAST * length)[: len(place)]
        first += len(place)
        second = np.tensordot(_seconds(), own[:6], 1)
        if len(place) == len(masses.MOMENTS):
            blocks.append(second)
            continue
        arm, mass, name = own[6:9], own[9], printable(made.names[i])
        top = np.concatenate([second, arm[:, np.newaxis]], axis=1)
        bottom = np.concatenate([arm, mass[np.newaxis]])[np.newaxis]
        blocks.append(np.concatenate([top, bottom]))
        total += mass
        known[f'm[{name}]'] = amount(mass)
        for k, (axis, middle) in enumerate(
            zip('xyz', found.moment[i] / found.mass[i], strict=True)
        ):
            ends = float(middle - length), float(middle + length)
            known[f'{axis}[{name}]'] = within(second[k, k], arm[k], mass, *ends)
    for rotor in places.rotors.values():
        numbers[first] = p[rotor]
        blocks.append(row[first][np.newaxis, np.newaxis])
        first += 1
    fixed = p.copy()
    if by_payload is not None:
        linear[:, -1], numbers[-1] = by_payload, robot.payload
        fixed -= by_payload * robot.payload
        blocks.append(row[-1][np.newaxis, np.newaxis])
        total += row[-1]
        known['payload'] = amount(row[-1])
    fixed[free] = 0.0
    known['mass'] = amount(total, *(WIDE * (total @ numbers)).tolist())
    return Bodies(numbers, linear, fixed, tuple(blocks), known)


def parameters(
    mechanism: Mechanism, robot: Parameters, places: NumberIndices, numbers: Array
) -> dict[str, Any]:
    """Keys of the robot with their values for these numbers."""
    factor, armature = np.array(robot.mass_factor), np.array(robot.armature)
    centre, extra = (
        np.reshape(np.array(each), (len(factor), -1))
        for each in (robot.centre_shift, robot.inertia_shift)
    )
    own = masses.spread(mechanism, robot)
    first = 0
    for i, place in places.links.items():
        given = numbers[first : first + len(place)]
        first += len(place)
        inertia = np.zeros((3, 3))
        for value, (a, b) in zip(given, masses.MOMENTS.values(), strict=False):
            inertia[a, b] = inertia[b, a] = value
        if len(place) > len(masses.MOMENTS):
            middle = given[6:9] / given[9]
            factor[i], centre[i] = given[9] / mechanism.mass[i], middle - mechanism.centre[i]
            inertia -= given[9] * masses.point(middle)
        difference = inertia / factor[i] - own[i]
        extra[i] = [difference[a, b] for a, b in masses.MOMENTS.values()]
    for i in places.rotors:
        armature[mechanism.actuated == i] = numbers[first]
        first += 1
    return {
        'mass_factor': tuple(factor),
        'centre_shift': tuple(centre.ravel()),
        'spread_factor': robot.spread_factor,
        'inertia_shift': tuple(extra.ravel()),
        'armature': tuple(armature),
        'payload': numbers[first] if first < len(numbers) else robot.payload,
    }


def _seconds() -> Array:
    """Second moments by the MOMENTS, shape (3, 3, 6)."""
    out = np.zeros((3, 3, len(masses.MOMENTS)))
    for column, (a, b) in enumerate(masses.MOMENTS.values()):
        inertia = np.zeros((3, 3))
        inertia[a, b] = inertia[b, a] = 1.0
        out[..., column] = masses.second_moments(inertia)
    return out


def _possible(found: masses.Masses, i: int, width: float) -> Array:
    """The ten numbers of a link, of a body that is at least so wide, shape (10,)."""
    mass, arm = found.mass[i], found.moment[i]
    origin = mass * masses.point(arm / mass) if mass else np.zeros((3, 3))
    sizes, axes = np.linalg.eigh(masses.second_moments(found.inertia[i] - origin))
    sizes = np.maximum(sizes, mass * width**2 if mass else 1e-6 * sizes.max())
    inertia = masses.inertia_of((axes * sizes) @ axes.T) + origin
    return np.array([*(inertia[a, b] for a, b in masses.MOMENTS.values()), *arm, mass])
