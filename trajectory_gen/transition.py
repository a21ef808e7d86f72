"""How a motion is entered from the one before it: one fades while the other begins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array


class Poses(NamedTuple):
    """Poses with two derivatives, each shape (N, m)."""

    pose: Array
    rate: Array
    acceleration: Array


class Entry(NamedTuple):
    """How a motion is entered from the one before it.

    Attributes:
        before: Poses of that one by times since the entry [s].
        duration: Time in which it fades [s].
        start: Time of the motion itself at the entry [s].
        delay: How long it waits there [s].
    """

    before: Callable[[Array], Poses]
    duration: float
    start: float
    delay: float

    def own_times(self, times: Any) -> Any:
        """Times of the motion itself at times since the entry [s]."""
        return self.start + np.maximum(times - self.delay, 0.0)


def blend(entry: Entry, times: Array, own: Poses) -> Poses:
    """Poses w before + (1 - w) own, where w falls from 1 to 0: a quintic polynomial.

    Args:
        entry: The entry.
        times: Times since then [s], shape (N,).
        own: Poses of the motion itself.
    """
    early = times < entry.duration
    if not early.any():
        return own
    times = times[early]
    weight, slope, bend = fading((1.0, 0.0, 0.0), entry.duration, times)
    (x, v, a), before = (part[early] for part in own), entry.before(times)
    dx, dv, da = before.pose - x, before.rate - v, before.acceleration - a
    blended = (
        x + weight * dx,
        v + weight * dv + slope * dx,
        a + weight * da + 2.0 * slope * dv + bend * dx,
    )
    made = Poses(*(part.copy() for part in own))
    for part, rows in zip(made, blended, strict=True):
        part[early] = rows
    return made


def fading(state: tuple[Any, Any, Any], duration: float, times: Array) -> Poses:
    """The quintic polynomial that leads from a state to rest in zero.

    Args:
        state: Value and two derivatives, numbers or shape (m,).
        duration: When it ends [s].
        times: Times before that [s], shape (N,).
    """
    T, u = duration, times[:, np.newaxis] / duration
    a, b, c = state[0], T * state[1], 0.5 * T**2 * state[2]
    left = 1.0 - u
    return Poses(
        (1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)) * a
        + u * left**3 * (1.0 + 3.0 * u) * b
        + u**2 * left**3 * c,
        (
            -30.0 * u**2 * left**2 * a
            + left**2 * (1.0 + 2.0 * u - 15.0 * u**2) * b
            + u * left**2 * (2.0 - 5.0 * u) * c
        )
        / T,
        (
            -60.0 * u * left * (1.0 - 2.0 * u) * a
            - 12.0 * u * left * (3.0 - 5.0 * u) * b
            + 2.0 * left * (1.0 - 8.0 * u + 10.0 * u**2) * c
        )
        / T**2,
    )
