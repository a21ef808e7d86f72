"""Gains that do not suit the noise of the sensors, which no controller knows but a simulation."""

from __future__ import annotations

import numpy as np

from parallel_robot_control.estimation.estimator import MEASURED, kind_for
from parallel_robot_sim.configuration import Configuration


def noise_doubts(configuration: Configuration) -> tuple[str, ...]:
    """What the active law says of the noise of the velocities that it is given.

    Nothing where they are estimated or differentiated: their noise is another one.
    """
    sensor = configuration.plant.imperfections.sensor
    name = configuration.loop.law
    law = configuration.control.laws[name]
    measured = kind_for(configuration.control.estimator, law) in MEASURED
    if not measured or sensor.differentiate:
        return ()
    of_law = getattr(law, 'judge_noise', None)
    noise = float(np.max(sensor.velocity_noise))
    if of_law is None or not noise:
        return ()
    doubts = of_law(configuration.control.gains[name], noise, configuration.loop.period)
    return tuple(f'{name}: {text}' for text in doubts)
