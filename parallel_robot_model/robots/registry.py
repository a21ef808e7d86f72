"""The robots by name. A new one is one module and one line here, and one file in config/robots."""

from __future__ import annotations

import contextlib
import functools
import warnings
from collections.abc import Mapping, Sequence
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple, cast

from numba import types

from parallel_robot_model.common.errors import (
    DescriptionWarning,
    InputError,
    UnknownNameError,
    printable,
)
from parallel_robot_model.common.units import HINGES, JointUnits
from parallel_robot_model.compiler import (
    INTERPRETED,
    Boxed,
    FunctionValue,
    VectorType,
    reason,
    shape_of,
)
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config import Modules
from parallel_robot_model.configuration.fields import (
    Declared,
    Field,
    Groups,
    check,
    declared_in,
    defaults,
    group,
    grouped,
)
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.processes import custom_module
from parallel_robot_model.processes.child_process import CALL_LIMIT, trial_step
from parallel_robot_model.processes.custom_module import qualify_type_names
from parallel_robot_model.robots import axes, planar_3rrr, serial_2r
from parallel_robot_model.robots.contract import (
    PLACE,
    Estimate,
    JointMotion,
    Location,
    Measurement,
    Robot,
    RobotModule,
    place_of,
    rotation_components_of,
)
from parallel_robot_model.robots.joint_load import DisturbanceParameters, FrictionParameters

ROBOTS = {
    'planar_3rrr': Robot.of(planar_3rrr),
    'axes': Robot.of(axes),
    'serial_2r': Robot.of(serial_2r),
}
for _robot in ROBOTS.values():  # before a kernel takes a tuple of one
    qualify_type_names(_robot.Constants, _robot.SafetyMargins)

KERNELS: dict[str, type] = {  # and what they return
    'joint_motion': JointMotion,
    'locate': Location,
    'estimate': Estimate,
    'acceleration': VectorType,
    'measure': Measurement,
}
OF_JOINTS = ('position', 'velocity', 'acceleration', 'M', 'Q', 'gravity')  # what has their size
SEE = ' (docs/robots.md, vectors)'
SHOWN = 3  # warnings of a machine, each in a line
GROUPS = ('Parameters', 'SafetyMargins', 'MotionLimits')
NEEDED = tuple(n for n in [*RobotModule.__annotations__, *vars(RobotModule)] if n[0] != '_')
_robot_of = functools.cache(Robot.of)  # one of each module


class RobotModel(NamedTuple):
    """A robot with its parameters."""

    name: str  # key of ROBOTS, or the name of a custom robot
    module: Robot
    parameters: Any

    @property
    def constants(self) -> Any:
        """What its kernels take, boxed: the constants of its module, or else the parameters.

        Those of a robot with OWN_MEMORY are new ones each time.
        """
        return _constants.__wrapped__(self) if self.module.OWN_MEMORY else _constants(self)

    @property
    def place(self) -> int:
        """Number of the first coordinates of its pose that are the place of its end effector."""
        return place_of(self.module.coordinates(self.parameters), self.planar)

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of its place, such as x and z; none without a place."""
        coordinates = self.module.coordinates(self.parameters)[: self.place]
        names = tuple(axis.name for axis in coordinates)
        return names if {*names} <= {*PLACE} else PLACE[: self.place]

    @property
    def joint_units(self) -> JointUnits:
        """Units of its actuated joints: rad and N m, or m and N of slides."""
        return JointUnits(tuple(unit == 'm' for unit in self.module.units(self.parameters)))

    @property
    def rotation_components(self) -> tuple[int, ...]:
        """Components of a rotation vector that follow its place in space, 0 to 2."""
        return rotation_components_of(self.module.coordinates(self.parameters))

    @property
    def planar(self) -> bool:
        """Whether its pose is a place in a plane, see PLANAR in the contract."""
        return bool(self.module.planar(self.parameters))

    @property
    def pose_size(self) -> int:
        """Number of the coordinates of its pose, m."""
        return len(self.module.coordinates(self.parameters))

    def pose_of(self, key: str, numbers: Any) -> tuple[float, ...]:
        """A pose of the robot, by the parameter in which it stands.

        Raises:
            InputError: it is none.
        """
        pose: tuple[float, ...] = check(key, tuple[float, ...], Field('', ''), numbers)
        if len(pose) != self.pose_size:
            names = ', '.join(axis.name for axis in self.module.coordinates(self.parameters))
            raise InputError(f'{key} must be [{names}], not {list(pose)}', key)
        return pose

    def kernel(self, name: str, *example: Any, instead: str = '') -> FunctionValue:
        """A kernel of the robot as a value.

        Args:
            name: Key of KERNELS.
            example: Its arguments after the constants, for their types.
            instead: A kernel with the same result that is taken.

        Raises:
            InputError: the kernel of a custom robot does not compile or returns something else.
        """
        function: Any = getattr(self.module, instead or name)
        if not hasattr(function, 'py_func'):
            raise InputError(f'{self.name}: {name} is not compiled: put @kernel before it')
        try:
            value = FunctionValue(function, _constants(self), *example)  # their type counts
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
    qualify_type_names(type(values))
    return Boxed(values)


def _unboxed(robot: RobotModel) -> Any:
    with custom_module.wrap_user_errors(robot.name):
        return robot.module.constants(robot.parameters)


def robots(paths: Sequence[str]) -> dict[str, Robot]:
    """The robots of the suite and custom ones, by name.

    Args:
        paths: Files of the custom robots.

    Raises:
        InputError: a file cannot be imported or is not a robot.
    """
    return ROBOTS | custom_robots(paths)


def custom_robots(paths: Sequence[str]) -> dict[str, Robot]:
    """Custom robots by name, see :func:`robots`."""
    needed = 'custom_robots', NEEDED, GROUPS, dry_run
    loaded = (custom_module.load(path, *needed) for path in paths)
    return {name: _robot_of(module) for name, module in loaded}


def module_of(loop: LoopParameters) -> Robot:
    """Module of the robot that moves in a loop.

    Raises:
        UnknownNameError: no such robot.
        InputError: a custom robot cannot be loaded.
    """
    if loop.robot_description:
        from parallel_robot_model.robots.described.robot import described  # it takes long to load

        return described(loop.robot_description, loop.robot_compiled)
    known, name = robots(loop.custom_robots), loop.robot_model
    if name not in known:
        raise UnknownNameError('robot_model', name, known, 'robot_model')
    return known[name]


def robot_with(
    module: Robot, loop: LoopParameters, parameters: Any, prefix: str = 'robot'
) -> RobotModel:
    """The robot of a loop with its parameters.

    Args:
        module: The robot's module.
        loop: It names the robot and its joints.
        parameters: Group of the robot's module.
        prefix: That of the parameters, for messages.

    Raises:
        InputError: a parameter is wrong, or the number of joints differs from that of their names.
    """
    names = loop.joints
    with custom_module.wrap_user_errors(loop.robot_model):
        robot = module.validate(parameters, prefix)
        count = module.joints(robot)
        module.coordinates(robot)
        remarks = module.parameter_warnings(robot)
    if count != len(names):
        what = f'joints must be {count} names, one for each joint, not {list(names)}'
        raise InputError(what, 'joints')
    _warn(loop.robot_model, remarks)
    return RobotModel(loop.robot_model, module, robot)


@functools.lru_cache(maxsize=64)  # once in a process
def _warn(name: str, remarks: tuple[str, ...]) -> None:
    """Warn of what is doubtful in a machine."""
    lines = [f'{name}: {printable(doubt)}' for doubt in remarks[:SHOWN]]
    if len(remarks) > SHOWN:
        lines.append(f'{name}: {len(remarks) - SHOWN} more; parallel_robot robot FILE tells all')
    if lines:
        warnings.warn('\n'.join(lines), DescriptionWarning, stacklevel=3)


def dry_run(module: ModuleType) -> None:
    """Call what a robot has in Python; what it raises is reported where it is called again."""
    with contextlib.suppress(*custom_module.RAISED), trial_step('its Python', CALL_LIMIT):
        made = Robot.of(cast(Any, module))
        parameters = group(default_values('it', made), made.Parameters, 'robot')
        robot = RobotModel('it', made, made.validate(parameters, 'robot'))
        made.joints(robot.parameters), robot.pose_size
        _unboxed(robot)  # to box them takes the compiler, whose time is not the file's


def default_values(name: str, robot: Robot) -> dict[str, Any]:
    """Defaults by key of a custom robot.

    It has them in its ``DEFAULTS``, flat or in groups, as the files in config/robots; those of
    its parameters may stand in ``Parameters`` instead.
    """
    given = robot.DEFAULTS
    if not isinstance(given, Mapping):
        raise InputError(f'{name}: DEFAULTS must be a dictionary, not {given!r}')
    given = config.flat(given)
    if len(robot.Parameters._field_defaults) == len(robot.Parameters._fields):
        given = defaults(robot.Parameters, 'robot.') | given
    return given


# From a configuration to its robots.


class RobotConfiguration(Groups):
    """The robots of a resolved configuration, and the loop in which they move.

    Each package derives its own from this, so that there is one configuration: its groups of
    parameters by name, and what is made of them when it is asked for. What is asked for raises
    InputError where a value is wrong, and says where that stands.
    """

    friction = grouped('friction', FrictionParameters)
    disturbance = grouped('disturbance', DisturbanceParameters)

    @cached_property
    def loop(self) -> LoopParameters:
        """Period, joints, law and the like."""
        return loop_of(self.values)

    @cached_property
    def module(self) -> Robot:
        """Module of the robot."""
        with with_location(self.values):
            return module_of(self.loop)

    @cached_property
    def robot(self) -> RobotModel:
        """The nominal robot."""
        return self.robot_at('robot')

    @cached_property
    def true_robot(self) -> RobotModel:
        """The robot of the plant."""
        return self.robot_at('true_robot')

    def robot_at(self, prefix: str) -> RobotModel:
        """The robot whose parameters have a prefix."""
        parameters = self.at(prefix, self.module.Parameters)
        with with_location(self.values):
            return robot_with(self.module, self.loop, parameters, prefix)


def robot_of(values: Mapping[str, Any], prefix: str = 'robot') -> RobotModel:
    """The robot of a resolved configuration; `prefix` ``true_robot`` is that of the plant.

    Raises:
        InputError: a parameter is wrong, or the number of joints differs from that of their names.
    """
    return RobotConfiguration(values).robot_at(prefix)


def declared_groups(robot: Robot) -> Declared:
    """Groups of the robots, nominal and true, and of the loads of their joints."""
    yield 'robot', robot.Parameters
    yield 'true_robot', robot.Parameters
    yield from declared_in(RobotConfiguration)


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


def load_robots(values: Mapping[str, Any]) -> Modules:
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
    return config.resolve(scenario, overrides, load_robots(overrides or {}))
