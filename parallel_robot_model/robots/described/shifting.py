"""A machine whose joints and loops lie elsewhere than its file says; they are closed anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.closing import close
from parallel_robot_model.mechanisms.mechanism import FOUND, POINT, Index, Mechanism
from parallel_robot_model.mechanisms.workspace import boxed

SHORTEST = 2.0**-6  # of the shift, that is closed at once


def loops(mechanism: Mechanism) -> list[Index]:
    """Rows of the closures that hold two points together, an array for each such pair."""
    rows: dict[tuple[float, ...], list[int]] = {}
    m = mechanism
    for k in np.flatnonzero(m.closure == POINT):
        pair = (m.first[k], m.second[k], *m.first_point[k], *m.second_point[k])
        rows.setdefault(pair, []).append(int(k))
    return [np.array(each) for each in rows.values()]


def shifted(mechanism: Mechanism, shift: Sequence[float]) -> Mechanism:
    """The machine with other origins of its joints, and other points where its loops close.

    The actuated joints of home stay, the passive ones follow. Closures that are redundant in the
    file stay out of account.

    Args:
        mechanism: The machine.
        shift: By which each joint lies elsewhere, on the link before [m], 3 numbers a joint; then
            the two points of each of its :func:`loops`, on their links, 6 numbers a loop.

    Raises:
        RobotError: its loops do not close.
    """
    if not any(shift):
        return mechanism
    whole, home, done, step = np.reshape(shift, (-1, 3)), mechanism.home, 0.0, 1.0
    origins, (firsts, seconds) = _parts(mechanism, whole)
    while done < 1.0:
        part = done + step
        moved = mechanism._replace(
            origin=mechanism.origin + part * origins,
            first_point=mechanism.first_point + part * firsts,
            second_point=mechanism.second_point + part * seconds,
            home=home,
        )
        value, made = boxed(moved)
        if close(value, made, made.q.copy()) == FOUND:
            home, done = made.all.copy(), done + step
            continue
        step *= 0.5
        if step < SHORTEST:
            raise RobotError('shift: the loops of the machine cannot be closed near home')
    return moved._replace(home=home)


def _parts(mechanism: Mechanism, shift: Array) -> tuple[Array, Array]:
    """What of it is of the joints, shape (N, 3), and of the closures, shape (2, r, 3)."""
    N = len(mechanism.parent)
    points = np.zeros((2, *mechanism.first_point.shape))
    for number, rows in enumerate(loops(mechanism)):
        for end in range(2):
            points[end, rows] = shift[N + 2 * number + end]
    return shift[:N], points
