"""Whether home is like the postures beside it: as many closures that are independent."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.mechanisms.description.assembly import Assembly
from parallel_robot_model.mechanisms.description.home import fitted
from parallel_robot_model.mechanisms.description.parts import rank
from parallel_robot_model.mechanisms.description.tree import Freedoms

BESIDE = 0.03  # rad, or of the length of the machine, to postures that are tried
TRIES = 3  # postures
MET = 1e-4  # what such a posture may leave open, relative to the length


def check_singular(source: str, parts: Assembly, held: list[int]) -> None:
    """Refuse a home in which the loops bind less than beside it.

    Args:
        source: What the machine is called in messages.
        parts: The machine at home.
        held: Joints that do not move.

    Raises:
        InputError: it is such a posture.
    """
    free = [i for i in range(len(parts.home)) if i not in held]
    at_home = rank(parts.closures()[:, free])
    for other in _beside(parts, free):
        if (more := rank(other.closures()[:, free])) > at_home:
            raise InputError(
                f'{source}: home is a singular posture: {at_home} closures of the loops are '
                f'independent there, {more} beside it; give another home'
            )


def doubted(parts: Assembly, freedoms: Freedoms) -> Iterator[str]:
    """Whether the closures that were chosen at home fail beside it."""
    free = [*freedoms.actuated, *freedoms.passive]
    for other in _beside(parts, free):
        matrix = other.closures()
        chosen = rank(matrix[freedoms.rows][:, freedoms.passive])
        if chosen < len(freedoms.rows) or rank(matrix[:, free]) < len(freedoms.rows):
            yield (
                f'{len(freedoms.rows)} closures are independent at home, but fewer beside it: '
                'do not move it far'
            )
            return


def _beside(parts: Assembly, free: list[int]) -> Iterator[Assembly]:
    """Closed postures near home, the same on every computer."""
    random = np.random.default_rng(0)
    for _ in range(TRIES if parts.equations else 0):
        start = parts.home.copy()
        start[free] += (BESIDE * random.uniform(-1.0, 1.0, len(start)) * parts.steps)[free]
        q = fitted(parts, start, free)
        if parts.gap(q) < MET * parts.length:
            yield parts._replace(home=q)
