"""From a configuration to its robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, JointUnits
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config import Modules
from parallel_robot_model.configuration.fields import Declared, group
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.configuration.plain_data import locating
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.disturbance import DisturbanceParameters
from parallel_robot_model.robots.friction import FrictionParameters
from parallel_robot_model.robots.registry import (
    RobotModel,
    custom_robots,
    default_values,
    module_of,
    robot_with,
    robots,
)

LOADS = (('friction', FrictionParameters), ('disturbance', DisturbanceParameters))


def declared(robot: Robot) -> Declared:
    """Groups of the robots, nominal and true, and of the loads of their joints."""
    yield 'robot', robot.Parameters
    yield 'true_robot', robot.Parameters
    yield from LOADS


def robot_of(values: Mapping[str, Any], prefix: str = 'robot') -> RobotModel:
    """The robot of a resolved configuration; `prefix` ``true_robot`` is that of the plant.

    Raises:
        InputError: a parameter is wrong, or the number of joints differs from that of their names.
    """
    loop = loop_of(values)
    with locating(values):
        module = module_of(loop)
        return robot_with(module, loop, group(values, module.Parameters, prefix), prefix)


def is_known(values: Mapping[str, Any]) -> bool:
    """Whether the robot is one of the suite, or the configuration has its file or description."""
    known = robots(values['custom_robots'])
    return bool(values.get('robot_description')) or values['robot_model'] in known


def units_of(values: Mapping[str, Any]) -> JointUnits:
    """Units of the joints of a resolved configuration; those of hinges if its robot is unknown."""
    try:
        return robot_of(values).joint_units if is_known(values) else HINGES
    except (InputError, KeyError):  # of a bag, what it has of a configuration
        return HINGES


def load(values: Mapping[str, Any]) -> Modules:
    """Load the custom robots that a configuration, or a change of one, names.

    Raises:
        InputError: one cannot be loaded.
    """
    own = custom_robots(config.module_files(values, 'custom_robots'))
    values_of = {name: default_values(name, robot) for name, robot in own.items()}
    return Modules(robots=values_of, described=_described)


def _described(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults of the machine that a configuration describes."""
    from parallel_robot_model.robots.described import robot  # it takes long to load

    return robot.default_values(values)


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of a custom robot; see :func:`config.resolve`.

    Gains of custom laws and parameters of custom trajectories are left as they are: their files
    are not loaded.
    """
    return config.resolve(scenario, overrides, load(overrides or {}))
