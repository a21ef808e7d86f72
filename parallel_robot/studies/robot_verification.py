"""One robot against its contract: whether its functions describe one machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot.studies.verification import SCENARIOS
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_model.robots.registry import KERNELS, load_robots
from parallel_robot_model.robots.robot_checks import RATE, Check, checks
from parallel_robot_sim.configuration import configure_plant

STATES = 20  # the first at the initial pose
SPREAD = 0.02  # m or rad, of the poses about it


def verify_robot(given: Mapping[str, Any], seed: int) -> tuple[str, list[Check]]:
    """Check a robot near its initial pose, with the parameters of the true one.

    Args:
        given: Keys of the configuration and their values, robot_model and custom_robots too.
        seed: Of poses and rates.

    Returns:
        Name of the robot, and of each check the worst result.

    Raises:
        InputError: a value is wrong, or a function of the robot cannot be used.
    """
    plant = configure_plant(values := values_of(given))
    robot = plant.robot
    margins = group(values, robot.module.SafetyMargins, 'safety')
    centre = np.array(robot.pose_of('plant.initial_pose', plant.parameters.initial_pose))
    random = np.random.default_rng(seed)
    worst: dict[tuple[str, str], Check] = {}
    for k in range(STATES):
        pose = centre + (random.uniform(-SPREAD, SPREAD, len(centre)) if k else 0.0)
        rate = random.uniform(-RATE, RATE, len(centre))
        try:
            found = [*checks(robot, plant.load, pose, rate, margins)]
        except InputError:
            if k:  # out of reach
                continue
            raise
        for check in found:
            key = check.function, check.what
            if key not in worst or not check.share <= worst[key].share:
                worst[key] = check
    missing = KERNELS.keys() - {function for function, _ in worst}
    what = 'anything within reach and margins, near plant.initial_pose'
    return robot.name, [*worst.values(), *(Check(each, what, np.nan, 0.0) for each in missing)]


def values_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration of one robot from what is given of it.

    Raises:
        InputError: a value is wrong.
    """
    scenario = SCENARIOS.get(str(given.get('robot_model')), 'paper_circle')
    own = load_robots(given).defaults({'robot_model': '', **given})  # of its poses, say
    return resolve(scenario, merged([own, given]))
