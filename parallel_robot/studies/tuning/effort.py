"""The effort of a trial: the metric that the error is traded against, and how much is allowed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from parallel_robot.studies.sweep.results import OTHERS, Quantity
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.units import HINGES, JointUnits

MEASURES = {quantity.column.rpartition('_')[0]: quantity for quantity in OTHERS}
DEFAULT = 'chattering'


@dataclass(frozen=True)
class Effort:
    """A measure of effort.

    Attributes:
        measure: Key of MEASURES.
        limit: Most effort of the gains that are taken, in the unit of the column; None: no limit.
        units: Those of the joints.
    """

    measure: str = DEFAULT
    limit: float | None = None
    units: JointUnits = HINGES

    @property
    def quantity(self) -> Quantity:
        """The column, its name and unit."""
        return MEASURES[self.measure].told(self.units)

    def shown(self, value: float) -> str:
        """A value of the column with its name and unit."""
        quantity = self.quantity
        return f'{quantity.name} {quantity.scale * value:.4g} {quantity.unit}'


def parse(text: str) -> Effort:
    """An effort from ``MEASURE`` or ``MEASURE=LIMIT``.

    Raises:
        InputError: there is no such measure, or the limit is not positive.
    """
    measure, equals, number = (part.strip() for part in text.partition('='))
    if measure not in MEASURES:
        raise UnknownNameError('measure of effort', measure, MEASURES)
    if not equals:
        return Effort(measure)
    try:
        limit = float(number)
    except ValueError:
        limit = math.nan
    if not 0.0 < limit < math.inf:
        raise InputError(f'--effort: {measure} must be a positive number, not {number!r}')
    return Effort(measure, limit / MEASURES[measure].scale)
