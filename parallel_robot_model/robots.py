"""The robots by name. A new one is one module and one line here, and one file in config/robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from parallel_robot_base import config, custom_module
from parallel_robot_base.errors import InputError, UnknownNameError, first_line
from parallel_robot_base.fields import defaults, parameters
from parallel_robot_model import axes, planar_3rrr, serial_2r
from parallel_robot_model.contract import Robot

ROBOTS: dict[str, Robot] = {
    'planar_3rrr': planar_3rrr,
    'axes': axes,
    'serial_2r': serial_2r,
}
GROUPS = ('Parameters', 'SafetyMargins', 'MotionLimits')
NEEDED = tuple(name for name in [*Robot.__annotations__, *vars(Robot)] if name[0] != '_')


class RobotModel(NamedTuple):
    """A robot with its parameters.

    Attributes:
        name: Key of ROBOTS, or the name of a custom robot.
        module: Its module.
        parameters: Its parameters.
    """

    name: str
    module: Robot
    parameters: Any

    @property
    def pose_size(self) -> int:
        """Number of the coordinates of its pose, m."""
        return len(self.module.coordinates(self.parameters))


def module_of(values: Mapping[str, Any]) -> Robot:
    """Module of the robot that a configuration names.

    Raises:
        UnknownNameError: no such robot.
        InputError: a custom robot cannot be loaded.
    """
    found = ROBOTS | custom_robots(values)
    name = str(values['robot_model'])
    if name not in found:
        raise UnknownNameError('robot_model', name, found)
    return found[name]


def is_known(values: Mapping[str, Any]) -> bool:
    """Whether the robot is one of the suite, or the configuration names its file."""
    return values['robot_model'] in ROBOTS | custom_robots(values)


def robot_of(values: Mapping[str, Any], prefix: str = 'robot') -> RobotModel:
    """The robot of a resolved configuration; `prefix` ``true_robot`` is that of the plant.

    Raises:
        InputError: a parameter is wrong, or the number of joints differs from that of their names.
    """
    module = module_of(values)
    robot = module.validate(config.group(values, module.Parameters, prefix), prefix)
    count, names = module.joints(robot), list(values['joints'])
    if count != len(names):
        raise InputError(f'joints must be {count} names, one for each joint, not {names}')
    return RobotModel(str(values['robot_model']), module, robot)


def custom_robots(values: Mapping[str, Any]) -> dict[str, Any]:
    """Custom robots that a configuration names, by name.

    Raises:
        InputError: a file cannot be imported or is not a robot.
    """
    found = {}
    for path in values['custom_robots']:
        name, module = custom_module.load(path, 'custom_robots', NEEDED)
        try:
            for group in GROUPS:
                parameters(getattr(module, group))
        except Exception as error:  # raised by its annotations
            raise InputError(f'custom_robots: {path}: {first_line(error)}') from error
        found[name] = module
    return found


def robot_defaults(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults by key of the custom robot of a configuration, if it has one.

    A custom robot has them in its ``DEFAULTS``, flat or in groups, as the files in config/robots;
    those of its parameters may stand in ``Parameters`` instead.
    """
    robot = custom_robots(values).get(str(values['robot_model']))
    if robot is None:
        return {}
    given = config.flat(getattr(robot, 'DEFAULTS', {}))
    known = getattr(robot.Parameters, '_field_defaults', {})
    if len(known) == len(robot.Parameters._fields):
        given = defaults(robot.Parameters, 'robot.') | given
    return given


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of a custom robot; see :func:`config.resolve`.

    Gains of custom laws are left as they are: their files are not loaded.
    """
    return config.resolve(scenario, overrides, robot_defaults)
