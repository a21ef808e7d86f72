"""Who drives a machine, who follows by its loops, and who is held."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.parts import independent, listed, null_space, rank

MOVED = 1e-5  # rate of the tool, relative to that of a joint, that counts as none


class Freedoms(NamedTuple):
    """The parts of the joints.

    Attributes:
        actuated: Indices of the joints that are driven, in the order that was asked for.
        passive: Those that follow by the closures, ascending.
        held: Those that were to be held, and those that nothing moves and that do not move the
            tool, ascending.
        rows: As many closures as passive joints, independent of each other, ascending.
    """

    actuated: list[int]
    passive: list[int]
    held: list[int]
    rows: list[int]


def divide(
    source: str,
    names: Sequence[str],
    closures: Array,
    tool: Array,
    actuated: list[int],
    held: list[int],
) -> Freedoms:
    """Divide the joints by what the closures leave free.

    Args:
        source: What the machine is called in messages.
        names: Of the N joints.
        closures: Derivative of the R closures by the joints, in one unit, shape (R, N).
        tool: Motion of the tool by the joints, in the same unit, shape (6, N).
        actuated: Joints that are driven.
        held: Joints that are to be held.

    Raises:
        InputError: there are more or fewer actuated joints than freedoms.
    """
    passive = [i for i in range(len(names)) if i not in {*actuated, *held}]
    free = [*actuated, *passive]
    own = closures[:, passive]
    follow, whole = rank(own), rank(closures[:, free])
    freedoms = len(free) - whole
    if follow < whole:
        surplus = [i for i in actuated if rank(closures[:, [*passive, i]]) > follow]
        raise InputError(
            f'{source}: {_many(len(actuated), "actuated joint")}, but the loops leave '
            f'{len(actuated) - whole + follow} of them free; drop '
            f'{whole - follow} of {listed(names[i] for i in surplus)}'
        )
    null = null_space(own)
    driftings = rank(_significant(tool[:, passive] @ null))
    if driftings:
        moved = tool[:, passive] @ null
        missing = [
            joint
            for i, joint in enumerate(passive)
            if rank(_significant(moved @ null_space(null[[i]]))) < driftings
        ]
        missing.sort(key=lambda i: '.' in names[i])  # parts of balls last
        raise InputError(
            f'{source}: {_many(freedoms, "freedom")}, but {len(actuated)} actuated: the tool '
            f'moves while they stand still; actuate {driftings} more, or hold them, of '
            f'{listed(names[i] for i in missing)}'
        )
    idle = [passive[i] for i in independent(null, null.shape[1])]
    passive = [i for i in passive if i not in idle]
    rows = independent(closures[:, passive], follow)
    return Freedoms(actuated, passive, sorted([*held, *idle]), rows)


def followed(closures: Array, freedoms: Freedoms) -> Array:
    """Motion of all N joints by that of the n actuated ones, shape (N, n)."""
    motion = np.zeros((closures.shape[1], len(freedoms.actuated)))
    motion[freedoms.actuated] = np.eye(len(freedoms.actuated))
    if freedoms.passive:
        rows = closures[freedoms.rows]
        motion[freedoms.passive] = -np.linalg.solve(
            rows[:, freedoms.passive], rows[:, freedoms.actuated]
        )
    return motion


def _significant(matrix: Array) -> Array:
    return np.where(np.abs(matrix) > MOVED, matrix, 0.0)


def _many(count: int, what: str) -> str:
    return f'{count} {what}' + 's' * (count != 1)
