"""Two links in a plane, and some masses and inertias beside them, as bodies of a linear model.

The numbers of a link are J = I + m lc^2, h = m lc and m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import Bodies, amount, within

MASSES = ('mp',)  # of the others


def bodies(
    robot: Any, others: Sequence[str], linear: Sequence[Mapping[str, float]], legs: int = 1
) -> Bodies:
    """The bodies of a robot.

    Args:
        robot: Its parameters.
        others: Its parameters beside those of the links; those that are zero stay so.
        linear: Factors of J1, h1, m1, J2, h2, m2 and the others, of each p.
        legs: Number of pairs of links.
    """
    others = [key for key in others if getattr(robot, key)]
    names = ['J1', 'h1', 'm1', 'J2', 'h2', 'm2', *others]
    row = dict(zip(names, np.eye(len(names)), strict=True))
    numbers = []
    known = {
        'mass': amount(
            legs * (row['m1'] + row['m2']) + sum(row[key] for key in others if key in MASSES)
        )
    }
    blocks = []
    for k in '12':
        m, lc, own, length = (getattr(robot, f'{key}{k}') for key in ('m', 'lc', 'I', 'l'))
        numbers += [own + m * lc**2, m * lc, m]
        J, h, mass = (row[f'{key}{k}'] for key in 'Jhm')
        blocks.append(np.array([[J, h], [h, mass]]))
        known[f'm{k}'] = amount(mass)
        known[f'lc{k}'] = within(0.0 * J, h, mass, 0.0, length)
    for key in others:
        numbers.append(getattr(robot, key))
        blocks.append(row[key][np.newaxis, np.newaxis])
        known[key] = amount(row[key])
    factors = np.array([[each.get(name, 0.0) for name in names] for each in linear])
    return Bodies(np.array(numbers), factors, np.zeros(len(linear)), tuple(blocks), known)


def parameters(robot: Any, others: Sequence[str], numbers: Array) -> dict[str, float]:
    """Keys of the robot with their values for these numbers."""
    found: dict[str, float] = {}
    for k, (J, h, m) in enumerate(numbers[:6].reshape(2, 3), 1):
        found |= {f'm{k}': m, f'lc{k}': h / m, f'I{k}': J - h**2 / m}
    rest = iter(numbers[6:])
    return found | {key: next(rest) if getattr(robot, key) else 0.0 for key in others}
