"""The limit of a sample of a study: what no law can do better on its robot."""

from __future__ import annotations

import math
from typing import NamedTuple

from parallel_robot.studies.limit.calm import WHOLE, Calm, least_error
from parallel_robot_model.common.errors import first_line
from parallel_robot_sim.configuration import Configuration


class Floor(NamedTuple):
    """The limit of a sample; the names are those of the columns.

    Attributes:
        limit_um: Least end-effector error of any law [um]; NaN without a plane.
        limit_urad: Least joint error, of a robot without a plane [urad]; NaN with one.
        delay_um: Distance that the reference travels while a state is late [um], see LeastError.
        limit_reason: Why there is no limit; empty if there is one.
    """

    limit_um: float = math.nan
    limit_urad: float = math.nan
    delay_um: float = math.nan
    limit_reason: str = ''


def floor_of(configuration: Configuration) -> Floor:
    """The limit of an experiment, whatever its law; a reason in place of an error."""
    try:
        found = least_error(configuration, causes=False)
    except Exception as error:  # custom robots raise anything
        return Floor(limit_reason=first_line(error))
    limit, delay = 1e6 * found.errors[WHOLE], 1e6 * found.travelled
    if not math.isfinite(limit):
        return Floor(delay_um=delay, limit_reason='the linear model of the motion is not finite')
    if configuration.plant.robot.place:
        return Floor(limit_um=limit, delay_um=delay)
    return Floor(limit_urad=limit, delay_um=delay)


def calm_of(configuration: Configuration) -> Calm | None:
    """The limit of an experiment by chattering; None where there is none."""
    try:
        return least_error(configuration, causes=False, calm=True).calm
    except Exception:  # custom robots raise anything
        return None
