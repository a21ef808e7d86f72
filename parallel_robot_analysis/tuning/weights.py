"""Weights: one objective from error and chattering, each relative to that of the default gains."""

from __future__ import annotations

import math
from typing import NamedTuple

from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_base.errors import InputError, UnknownNameError


class Weights(NamedTuple):
    """Weights of the two objectives; what is not given counts nothing."""

    error: float = 0.0
    chattering: float = 0.0

    def cost(self, trial: Trial, default: Trial) -> float:
        """Weighted sum of the figures of a trial, relative to those of the default gains."""
        relative = (trial.error / (default.error or 1.0)) if self.error else 0.0
        smooth = (trial.chattering / (default.chattering or 1.0)) if self.chattering else 0.0
        return self.error * relative + self.chattering * smooth


def parse(text: str) -> Weights:
    """Weights from ``error=2,chattering=1``.

    Raises:
        InputError: a name is unknown or stands twice, or a weight is not positive.
    """
    found: dict[str, float] = {}
    for word in text.split(','):
        name, equals, number = (part.strip() for part in word.partition('='))
        if not equals:
            raise InputError(f'--weights takes error=NUMBER,chattering=NUMBER, not {text!r}')
        if name not in Weights._fields:
            raise UnknownNameError('weight', name, Weights._fields)
        if name in found:
            raise InputError(f'--weights names {name} twice')
        try:
            found[name] = float(number)
        except ValueError:
            found[name] = math.nan
        if not 0.0 < found[name] < math.inf:
            raise InputError(f'--weights: {name} must be a positive number, not {number!r}')
    return Weights(**found)
