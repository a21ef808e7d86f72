"""How much of the least error each cause is answerable for: the limit without it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import SMOOTH, samples_beside
from parallel_robot.studies.limit.calm import REST, Calm, price_of_calm
from parallel_robot.studies.limit.geometry import geometry_error
from parallel_robot.studies.limit.linear_motion import linearise
from parallel_robot.studies.limit.prediction import EXACT, Noise, least, noise_of
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.configuration import Configuration, assemble_plant
from parallel_robot_sim.ideal_torque import coordinates_of, points_of

NEGLIGIBLE = 1e-9  # m or rad: what rounding leaves of no limit at all
WHOLE = 'as it is'
CAUSES: dict[str, Callable[[Noise], Noise]] = {
    WHOLE: lambda noise: noise,
    'without delays': lambda noise: noise._replace(late=0),
    'positions exact': lambda noise: noise._replace(
        position=np.full_like(noise.position, EXACT[0])
    ),
    'velocities exact': lambda noise: noise._replace(
        velocity=np.full_like(noise.velocity, EXACT[1])
    ),
    'no velocities': lambda noise: noise._replace(velocity=np.full_like(noise.velocity, np.inf)),
    'without disturbance': lambda noise: noise._replace(
        disturbance=np.zeros_like(noise.disturbance), motor=np.zeros_like(noise.motor)
    ),
}


class LeastError(NamedTuple):
    """The least errors of one robot, over the second half of its motion.

    Attributes:
        errors: Root mean square by key of CAUSES [m], or [rad] without a plane.
        travelled: Distance that the reference travels while a state is late, root mean square [m].
            A law that believes late states to be new is that far behind. NaN without a plane,
            and where stamps tell when states were measured, so that no law need believe it.
        geometry: Error of a robot whose joints, as they are measured, are exactly where they
            should be: that of its geometry and zero angles alone. NaN where it was not asked for.
        calm: Least errors by chattering; None where it was not asked for or the limit is zero.
    """

    errors: dict[str, float]
    travelled: float
    geometry: float = np.nan
    calm: Calm | None = None


def _in_motion(configuration: Configuration) -> Configuration:
    """An experiment up to the end of its motion, as all metrics are."""
    end, loop = configuration.trajectory.end, configuration.loop
    if end is None or end >= loop.duration:
        return configuration
    loop = loop._replace(duration=end)
    return configuration._replace(loop=loop, plant=configuration.plant._replace(loop=loop))


def least_error(
    configuration: Configuration, causes: bool = True, calm: bool = False, rest: float = REST
) -> LeastError:
    """Compute the least errors of one robot.

    Args:
        configuration: The experiment; its law and gains are of no account.
        causes: Whether all CAUSES are asked for, and what geometry costs, or only WHOLE.
        calm: Whether the price of calm is asked for.
        rest: Its weight of joints that the error does not see, relative.

    Raises:
        InputError: the robot does not reach the motion; there is no steady state to be calm in,
            or the period is too long for chattering.
    """
    configuration = _in_motion(configuration)
    loop, plant = configuration.loop, configuration.plant
    if calm and not samples_beside(loop.period):
        raise InputError(
            f'no price of calm with a period of {loop.period:g} s: chattering is what varies '
            f'within {SMOOTH:g} s; choose a shorter period'
        )
    noise = noise_of(plant.imperfections, loop.period, len(loop.joints))
    asked = CAUSES if causes else {WHOLE: CAUSES[WHOLE]}
    times = points_of(loop.duration)
    if noise.moves():
        motion = linearise(configuration)
        found = {
            name: least(motion, without(noise), loop.period) for name, without in asked.items()
        }
    else:  # a state that is known at the start stays known, on a motion within reach
        poses = configuration.trajectory.sample(times).pose
        coordinates_of(plant.robot, assemble_plant(plant), poses)
        found = dict.fromkeys(asked, 0.0)
    steady = times[times >= 0.5 * times[-1]]
    travelled, price = np.nan, None
    told = plant.imperfections.age > 0.0
    if plant.robot.place and not told:
        rate = configuration.trajectory.sample(steady).pose_rate[:, : plant.robot.place]
        late = np.floor(plant.imperfections.sensor.delay / loop.period + 0.5) * loop.period
        travelled = float(late * np.sqrt(np.mean(np.sum(rate**2, axis=1))))
    geometry = geometry_error(configuration, steady) if causes else np.nan
    if calm and found[WHOLE] > NEGLIGIBLE:
        try:
            price = price_of_calm(motion, noise, loop.period, rest)
        except np.linalg.LinAlgError as error:
            raise InputError(f'no price of calm: {error}') from None
    return LeastError(found, travelled, geometry, price)
