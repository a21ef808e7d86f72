"""States and references as they come, put together into motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.run.matching import reference_at
from parallel_robot_control.contract import JointReference
from parallel_robot_model.common.units import NANOSECONDS, Array

OLDEST = NANOSECONDS // 10  # ns, largest age of a reference that is still used
GAP = NANOSECONDS  # ns between two states, beyond which another motion begins
KEPT = 2000  # references


class States(NamedTuple):
    """Some states with their references, one row each.

    Attributes:
        stamps: [ns], shape (N,).
        position: [rad], shape (N, n).
        velocity: [rad/s], shape (N, n).
        effort: [N m], shape (N, n).
        references: When the torques act, NaN where none is recent enough, each shape (N, n).
        desired: Position of the reference at the stamps [rad], likewise, shape (N, n).
        anew: Whether another motion begins with them.
    """

    stamps: NDArray[np.int64]
    position: Array
    velocity: Array
    effort: Array
    references: JointReference
    desired: Array
    anew: bool


class MotionBuffer:
    """Keeps references until the states have come that need them."""

    def __init__(self, joints: int, age: int = 0) -> None:
        """Begin without any.

        Args:
            joints: Number of the actuated joints, n.
            age: From the measurement of a state to the torque that answers it [ns].
        """
        self._age = age
        self._last: int | None = None  # ns, stamp of the newest state
        self._known = np.zeros(0, dtype=np.int64)
        self._rows = JointReference(*(np.zeros((0, joints)) for _ in range(3)))

    def add_references(self, stamps: NDArray[np.int64], rows: tuple[Array, ...]) -> None:
        """Take references: stamps [ns], shape (M,); position and derivatives, shape (M, n)."""
        known = np.concatenate([self._known, stamps])
        back = np.flatnonzero(np.diff(known) <= 0)  # another motion, or another publisher
        kept = slice(max(int(back[-1]) + 1 if back.size else 0, len(known) - KEPT), None)
        self._known = known[kept]
        self._rows = JointReference(
            *(np.concatenate([old, new])[kept] for old, new in zip(self._rows, rows, strict=True))
        )

    def add_states(self, stamps: NDArray[np.int64], rows: tuple[Array, ...]) -> States | None:
        """Take states: stamps [ns], shape (N,); position, velocity, effort, each shape (N, n).

        Returns:
            Those of the newest motion; None without any.
        """
        if not len(stamps):
            return None
        before = stamps[0] - 1 if self._last is None else self._last
        steps = np.diff(stamps, prepend=before)
        breaks = np.flatnonzero((steps < 0) | (steps > GAP))
        first = int(breaks[-1]) if breaks.size else 0
        kept = np.flatnonzero(steps != 0)  # a plant repeats states in lockstep
        kept = kept[kept >= first]
        if not kept.size:
            return None
        stamps = stamps[kept]
        anew = bool(breaks.size) or self._last is None
        self._last = int(stamps[-1])
        position, velocity, effort = (row[kept] for row in rows)
        references, desired = self._at(stamps + self._age), self._at(stamps).position
        return States(stamps, position, velocity, effort, references, desired, anew)

    def _at(self, stamps: NDArray[np.int64]) -> JointReference:
        """References at some stamps [ns], NaN where none is recent enough."""
        if not len(self._known):
            none = np.full((len(stamps), self._rows.position.shape[1]), np.nan)
            return JointReference(none, none, none)
        found = reference_at(stamps, self._known, *self._rows)
        newest = np.searchsorted(self._known, stamps, side='right') - 1
        stale = (newest < 0) | (stamps - self._known[newest] > OLDEST)
        for row in found:
            row[stale] = np.nan
        return found
