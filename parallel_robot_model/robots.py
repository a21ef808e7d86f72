"""The robots by name. A new one is one module and one line here, and one file in config/robots."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

from numba import types

from parallel_robot_base import config, custom_module
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_base.fields import defaults
from parallel_robot_base.trial_process import LIMIT, step
from parallel_robot_compiler import (
    INTERPRETED,
    Boxed,
    FirstClass,
    VectorType,
    distinguish,
    reason,
    shape_of,
)
from parallel_robot_model import axes, planar_3rrr, serial_2r
from parallel_robot_model.contract import Estimate, JointMotion, Location, Measurement, Robot

ROBOTS: dict[str, Robot] = {
    'planar_3rrr': planar_3rrr,
    'axes': axes,
    'serial_2r': serial_2r,
}
KERNELS: dict[str, type] = {  # and what they return
    'joint_motion': JointMotion,
    'locate': Location,
    'estimate': Estimate,
    'acceleration': VectorType,
    'measure': Measurement,
}
OF_JOINTS = ('position', 'velocity', 'acceleration', 'M', 'Q', 'gravity')  # what has their size
SEE = ' (docs/robots.md, vectors)'
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
    def constants(self) -> Any:
        """What its kernels take, boxed: the constants of its module, or else the parameters."""
        return _constants(self)

    @property
    def pose_size(self) -> int:
        """Number of the coordinates of its pose, m."""
        return len(self.module.coordinates(self.parameters))

    def kernel(self, name: str, *example: Any) -> FirstClass:
        """A kernel of the robot as a value.

        Args:
            name: Key of KERNELS.
            example: Its arguments after the constants, for their types.

        Raises:
            InputError: the kernel of a custom robot does not compile or returns something else.
        """
        function: Any = getattr(self.module, name)
        if not hasattr(function, 'py_func'):
            raise InputError(f'{self.name}: {name} is not compiled: put @kernel before it')
        try:
            value = FirstClass(function, self.constants, *example)
        except Exception as error:  # Numba has many
            cause = reason(error, function.py_func)
            see = SEE if 'Vector(' in cause else ''
            raise InputError(f'{self.name}: {name} does not compile: {cause}{see}') from error
        if INTERPRETED:  # the types are those of the values
            return value
        returned = value.signature().return_type
        if getattr(returned, 'instance_class', type(returned)) is not KERNELS[name]:
            raise InputError(f'{self.name}: {name} must return {_named(name)}')
        sizes = dict.fromkeys(OF_JOINTS, self.module.joints(self.parameters))
        sizes |= {'pose': self.pose_size}
        if name == 'acceleration':
            sizes = {name: len(example[1])}  # that of the coordinates
        wrong = _wrong(name, returned, sizes)
        if wrong:
            raise InputError(f'{self.name}: {name} returns {wrong}{SEE}')
        return value


def _named(kernel: str) -> str:
    kind = KERNELS[kernel]
    return f'a vector{SEE}' if kind is VectorType else kind.__name__


def _wrong(name: str, kind: Any, sizes: Mapping[str, int]) -> str:
    """What is wrong in a result of a kernel: arrays, or vectors of wrong sizes."""
    if isinstance(kind, types.BaseTuple):
        fields = zip(getattr(kind, 'fields', ()), kind.types, strict=False)
        return next(filter(None, (_wrong(*field, sizes) for field in fields)), '')
    if isinstance(kind, types.Array):
        return f'{name} as an array, not as a vector'
    shape, _ = shape_of(kind)
    if name in sizes and set(shape) != {sizes[name]}:
        return f'{name} of shape {shape}, not of size {sizes[name]}'
    return ''


@functools.lru_cache(maxsize=64)
def _constants(robot: RobotModel) -> Boxed:
    values = _unboxed(robot)
    distinguish(values)
    return Boxed(values)


def _unboxed(robot: RobotModel) -> Any:
    made = getattr(robot.module, 'constants', None)  # optional in the contract
    with custom_module.blaming(robot.name):
        return made(robot.parameters) if made else robot.parameters


def module_of(values: Mapping[str, Any]) -> Robot:
    """Module of the robot that a configuration names.

    Raises:
        UnknownNameError: no such robot.
        InputError: a custom robot cannot be loaded.
    """
    found = ROBOTS | custom_robots(values)
    name = str(values['robot_model'])
    if name not in found:
        raise UnknownNameError('robot_model', name, found, 'robot_model')
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
    group, name = config.group(values, module.Parameters, prefix), str(values['robot_model'])
    with custom_module.blaming(name):
        robot = module.validate(group, prefix)
        count, names = module.joints(robot), list(values['joints'])
        module.coordinates(robot)
    if count != len(names):
        what = f'joints must be {count} names, one for each joint, not {names}'
        raise InputError(what, 'joints')
    return RobotModel(name, module, robot)


def custom_robots(values: Mapping[str, Any]) -> dict[str, Any]:
    """Custom robots that a configuration names, by name.

    Raises:
        InputError: a file cannot be imported or is not a robot.
    """
    paths = values['custom_robots']
    return dict(
        custom_module.load(path, 'custom_robots', NEEDED, GROUPS, rehearse) for path in paths
    )


def rehearse(module: ModuleType) -> None:
    """Call what a robot has in Python; what it raises is told where it is called again."""
    found: Any = module
    with contextlib.suppress(*custom_module.RAISED), step('its Python', LIMIT):
        group = config.group(_defaults('it', found), found.Parameters, 'robot')
        robot = RobotModel('it', found, found.validate(group, 'robot'))
        found.joints(robot.parameters), robot.pose_size
        _unboxed(robot)  # to box them takes the compiler, whose time is not the file's


def robot_defaults(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults by key of the custom robot of a configuration, if it has one.

    A custom robot has them in its ``DEFAULTS``, flat or in groups, as the files in config/robots;
    those of its parameters may stand in ``Parameters`` instead.
    """
    name = str(values['robot_model'])
    robot = custom_robots(values).get(name)
    return {} if robot is None else _defaults(name, robot)


def _defaults(name: str, robot: Any) -> dict[str, Any]:
    given = getattr(robot, 'DEFAULTS', {})
    if not isinstance(given, Mapping):
        raise InputError(f'{name}: DEFAULTS must be a dictionary, not {given!r}')
    given = config.flat(given)
    known = getattr(robot.Parameters, '_field_defaults', {})
    if len(known) == len(robot.Parameters._fields):
        given = defaults(robot.Parameters, 'robot.') | given
    return given


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of a custom robot; see :func:`config.resolve`.

    Gains of custom laws and parameters of custom trajectories are left as they are: their files
    are not loaded.
    """
    return config.resolve(scenario, overrides, robot_defaults)
