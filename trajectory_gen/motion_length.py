"""How long a run is: what it is told, else as long as its motion, else some turns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.loop import DURATION
from parallel_robot_model.configuration.plain_data import Placed, merged
from trajectory_gen.configuration import resolve, trajectory_of

KEY = 'duration'


def with_duration(scenario: str, changed: Mapping[str, Any], hold: float | None = None) -> Placed:
    """Changes of a scenario that say how long its run is.

    Args:
        scenario: Name of a scenario, or the path of its file.
        changed: Key to value; where it has a duration, that counts.
        hold: Time for which the robot is held where its motion ended [s]; None: it is not asked
            for.

    Returns:
        The changes. Where neither they nor the scenario say how long the run is, it is as long as
        its motion, in whole periods, or DURATION where the motion has no end.

    Raises:
        InputError: a value is wrong, or the motion that is to be followed by a hold has no end.
    """
    told = KEY in changed or bool(config.scenario_values(scenario).get(KEY))
    if hold is None and told:
        return merged([changed])
    values = resolve(scenario, changed)
    end = trajectory_of(values).end
    if hold is None:
        duration = DURATION if end is None else end
    else:
        hold = check('hold', float, Field('s', '', 0.0), hold)
        if KEY in changed:
            raise InputError(
                'hold and duration exclude each other: hold is from the end of the motion on'
            )
        if end is None:
            raise InputError('hold is for a motion that comes to an end; this one has none')
        duration = end + hold
    period = float(values['period'])
    samples = max(1, math.ceil(duration / period - 1e-6))
    return merged([{KEY: round(samples * period, 9)}, changed])
