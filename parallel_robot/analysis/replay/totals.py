"""What came of torques that were computed again, added up over the parts of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.replay.replayed import Replay
from parallel_robot_model.common.tables import Table
from parallel_robot_model.common.units import HINGES, Array, JointUnits


class Totals(NamedTuple):
    """Figures of a part of a run, or of all of it.

    Attributes:
        states: Number of states.
        answered: How many were answered again.
        known: How many have a recorded command.
        differing: How many commands are not the recorded ones, bit for bit.
        first: Time of the first of those [s]; NaN where there is none.
        most: Largest difference of those [N m].
        largest: Largest difference of each joint [N m], shape (n,).
        squares: Sum of their squares [N^2 m^2], shape (n,).
        late: How many states were answered with a reference that came late.
        remembered: Whether it is known what law and estimator remembered at the first state.
    """

    states: int
    answered: int
    known: int
    differing: int
    first: float
    most: float
    largest: Array
    squares: Array
    late: int
    remembered: bool

    def and_then(self, after: Totals) -> Totals:
        """The figures with those of the part that follows."""
        return Totals(
            self.states + after.states,
            self.answered + after.answered,
            self.known + after.known,
            self.differing + after.differing,
            after.first if math.isnan(self.first) else self.first,
            max(self.most, after.most),
            np.maximum(self.largest, after.largest),
            self.squares + after.squares,
            self.late + after.late,
            after.remembered,
        )

    def verdict(self, said: bool, units: JointUnits = HINGES) -> list[str]:
        """Whether the torques are the recorded commands.

        Args:
            said: Whether the bag says which states were answered.
            units: Units of the joints.
        """
        lines = []
        if self.late:
            lines.append(f'{self.late} states were answered with a reference that came late')
        if self.known < self.states:
            what = 'were not answered' if said else 'have no recorded command'
            lines.append(f'{self.states - self.known} states {what}')
        if not self.differing:
            return [*lines, f'identical: {self.known} commands']
        if not self.remembered:
            lines.append(
                'not compared: the bag begins while the controller ran, and what law and '
                'estimator remembered then is not in it; with an empty memory:'
            )
        return [
            *lines,
            f'{self.differing} of {self.known} commands differ, by up to {self.most:.3g} '
            f'{units.of("N m")}, '
            f'from t = {self.first:.3f} s on',
        ]

    def differences(self) -> dict[str, Array]:
        """Differences to the recorded commands [N m], each shape (n,)."""
        return {'rms': np.sqrt(self.squares / self.known), 'max': self.largest}

    def table(self, joints: Sequence[str], units: JointUnits = HINGES) -> Table:
        """Difference to the recorded commands, joint by joint."""
        rows = self.differences().items()
        cells = [[name, *(f'{value:.3f}' for value in values)] for name, values in rows]
        return Table([units.label('difference of torques [N m]'), *joints], cells)


def of(time: Array, result: Replay) -> Totals:
    """The figures of some states; `time` of them [s], shape (N,)."""
    differing, known = np.flatnonzero(result.differing), result.known
    difference = np.abs(result.torque - result.recorded)
    return Totals(
        len(time),
        int((~np.isnan(result.torque[:, 0])).sum()),
        int(known.sum()),
        len(differing),
        float(time[differing[0]]) if differing.size else math.nan,
        float(difference[differing].max()) if differing.size else 0.0,
        difference[known].max(axis=0, initial=0.0),
        (difference[known] ** 2).sum(axis=0),
        result.late,
        result.remembered,
    )
