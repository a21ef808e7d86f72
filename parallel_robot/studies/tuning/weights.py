"""Weights: one objective from error and effort, each relative to that of the default gains."""

from __future__ import annotations

import math
from typing import NamedTuple

from parallel_robot.studies.tuning.trial import Trial
from parallel_robot_model.common.errors import InputError, UnknownNameError


class Weights(NamedTuple):
    """Weights of the two objectives; omitted weights are zero."""

    error: float = 0.0
    effort: float = 0.0

    def cost(self, trial: Trial, default: Trial) -> float:
        """Weighted sum of the figures of a trial, relative to those of the default gains."""
        relative = (trial.error / (default.error or 1.0)) if self.error else 0.0
        spent = (trial.effort / (default.effort or 1.0)) if self.effort else 0.0
        return self.error * relative + self.effort * spent


def parse(text: str, measure: str) -> Weights:
    """Weights from ``error=2,chattering=1``.

    Args:
        text: The words.
        measure: What the effort is called.

    Raises:
        InputError: a name is unknown or stands twice, or a weight is not positive.
    """
    names = {'error': 'error', measure: 'effort'}
    found: dict[str, float] = {}
    for word in text.split(','):
        name, equals, number = (part.strip() for part in word.partition('='))
        if not equals:
            raise InputError(f'--weights takes error=NUMBER,{measure}=NUMBER, not {text!r}')
        if name not in names:
            raise UnknownNameError('weight', name, names)
        if names[name] in found:
            raise InputError(f'--weights names {name} twice')
        try:
            weight = float(number)
        except ValueError:
            weight = math.nan
        if not 0.0 < weight < math.inf:
            raise InputError(f'--weights: {name} must be a positive number, not {number!r}')
        found[names[name]] = weight
    return Weights(**found)
