"""From a configuration to its controller: robot, limits, laws and their gains."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple, get_type_hints

import numpy as np

from parallel_robot_control import law_loader
from parallel_robot_control.approach import ApproachParameters
from parallel_robot_control.contract import Law
from parallel_robot_control.estimation.estimator import EstimatorParameters
from parallel_robot_control.estimation.lock_in import LockInParameters
from parallel_robot_control.laws import LAWS
from parallel_robot_control.prepared_law import judge
from parallel_robot_control.repetition import RepetitionParameters, turn_of
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import config, fields
from parallel_robot_model.configuration.config import PRESET, Modules
from parallel_robot_model.configuration.fields import (
    Declared,
    Field,
    Groups,
    build_groups,
    defaults,
    group,
    parameters,
    plain,
)
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.configuration.plain_data import locating
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.registry import RobotModel, robot_of
from trajectory_gen import configuration as motion
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.shapes import shapes
from trajectory_gen.trajectory import Trajectory


class ControllerParameters(NamedTuple):
    """Parameters of the controller itself, besides robot and law."""

    guess: Annotated[
        tuple[float, ...],
        Field('', 'pose from which the first forward kinematics starts, as of the robot'),
    ]
    stopped: Annotated[bool, Field('', 'true: it begins in emergency stop, until ~/clear_fault')]
    lifecycle: Annotated[
        bool, Field('', 'true: a managed node, which sends commands only while it is active')
    ]


class ControlConfiguration(NamedTuple):
    """Configuration of a controller."""

    loop: LoopParameters  # period, joints, active law and the like
    robot: RobotModel  # nominal robot
    margins: Any  # SafetyMargins of the robot
    guess: tuple[float, ...]  # pose from which the first forward kinematics starts, m numbers
    turn: int  # samples of a turn; 0 where nothing is learned
    laws: Mapping[str, Law]  # all laws by name
    gains: Mapping[str, Any]  # gains of each law
    # groups of parameters, by their prefixes
    controller: ControllerParameters
    estimator: EstimatorParameters
    lock_in: LockInParameters
    approach: ApproachParameters
    repetition: RepetitionParameters
    safety: SafetyParameters

    @property
    def stopped(self) -> bool:
        """Whether the controller begins in emergency stop."""
        return self.controller.stopped or self.controller.lifecycle

    @property
    def custom(self) -> bool:
        """Whether the robot or a law is a custom one."""
        return bool(self.loop.custom_laws or self.loop.custom_robots)

    @property
    def joints(self) -> int:
        """Number of the actuated joints, n."""
        return len(self.loop.joints)


FIRST = ControlConfiguration._fields.index('controller')
GROUPS = dict([*get_type_hints(ControlConfiguration).items()][FIRST:])


def load(values: Mapping[str, Any]) -> Modules:
    """Load the custom robots, laws and trajectories that a configuration, or a change, names.

    Raises:
        InputError: one cannot be loaded.
    """
    loaded = motion.load(values)
    laws = law_loader.custom_laws(config.module_files(values, 'custom_laws'))
    return loaded._replace(
        laws={name: defaults(law.Gains, f'{name}.') for name, law in laws.items()}
    )


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of custom modules; see :func:`config.resolve`."""
    return config.resolve(scenario, overrides, load(overrides or {}))


def available(paths: Sequence[str]) -> dict[str, Law]:
    """The laws of the suite and custom ones, by name.

    Args:
        paths: Files of the custom laws.

    Raises:
        InputError: a file cannot be imported or is not a law.
    """
    return LAWS | law_loader.custom_laws(paths)


def of_laws(laws: Mapping[str, Law]) -> Declared:
    """Groups of the gains of some laws."""
    for name, law in laws.items():
        yield name, law.Gains


def declared(robot: Robot, laws: Mapping[str, Law]) -> Declared:
    """Groups of the controller and of all its laws."""
    yield from GROUPS.items()
    yield 'safety', robot.SafetyMargins
    yield from of_laws(laws)


def configure(values: Mapping[str, Any]) -> ControlConfiguration:
    """Build the configuration of a controller from a resolved one.

    Raises:
        UnknownNameError: no such law.
        InputError: a value is wrong, or the theory of a law forbids its gains.
    """
    loop, nominal = loop_of(values), robot_of(values)
    with locating(values):
        laws = available(loop.custom_laws)
        groups = build_groups(values, declared(nominal.module, laws))
        guess = groups[ControllerParameters].guess or _first_pose(values)
        return control_from(loop, groups, nominal, laws, guess, lambda: trajectory_of(values))


def control_from(
    loop: LoopParameters,
    groups: Groups,
    robot: RobotModel,
    laws: Mapping[str, Law],
    guess: tuple[float, ...],
    motion: Callable[[], Trajectory],
) -> ControlConfiguration:
    """Build the configuration of a controller from typed groups.

    Args:
        loop: Period, joints, active law and the like.
        groups: What :func:`declared` names.
        robot: The nominal robot.
        laws: All laws by name.
        guess: Pose from which the first forward kinematics starts.
        motion: Gives the desired motion, where something is learned from its turns.

    Raises:
        UnknownNameError: no such law.
        InputError: the theory of a law forbids its gains, the guess is no pose, or a motion of
            which is learned does not repeat.
    """
    gains = {name: groups.at(name, law.Gains) for name, law in laws.items()}
    for name, law in laws.items():
        judge(name, law, gains[name])
    repetition = groups[RepetitionParameters]
    turn = turn_of(repetition, motion(), loop.period) if repetition.gain else 0
    return ControlConfiguration(
        _with_law(loop, loop.law, laws),
        robot,
        groups[robot.module.SafetyMargins],
        checked(guess, robot),
        turn,
        laws,
        gains,
        *(groups.at(*each) for each in GROUPS.items()),
    )


def nominal_of(values: Mapping[str, Any]) -> tuple[RobotModel, Array]:
    """The nominal robot of a resolved configuration, and where its forward kinematics starts.

    Returns:
        The robot; the parameter ``controller.guess``, or the first pose of the trajectory,
        shape (m,).

    Raises:
        InputError: a parameter is wrong.
    """
    robot, given = robot_of(values), group(values, ControllerParameters, 'controller').guess
    with locating(values):
        return robot, np.array(checked(given or _first_pose(values), robot))


def checked(guess: Sequence[float], robot: RobotModel) -> tuple[float, ...]:
    """A first guess that is a pose of the robot.

    Raises:
        InputError: it is none.
    """
    names = [axis.name for axis in robot.module.coordinates(robot.parameters)]
    if len(guess) != len(names):
        raise InputError(
            f'controller.guess must be empty or [{", ".join(names)}], not {list(guess)}',
            'controller.guess',
        )
    return tuple(guess)


def _first_pose(values: Mapping[str, Any]) -> tuple[float, ...]:
    """The first pose of the motion.

    Where the file of a custom trajectory is not loaded, as for a bag, it is the initial pose.
    """
    if values['trajectory.shape'] not in shapes(values['custom_trajectories']):
        return tuple(map(float, values['plant.initial_pose']))
    return trajectory_of(values).first_pose


def preset_of(loop: LoopParameters) -> Mapping[str, Any]:
    """Gains of all laws of a loop in the preset, by name."""
    return _preset(
        loop.robot_model, loop.custom_laws, loop.custom_robots, loop.custom_trajectories
    )


@functools.lru_cache(maxsize=4)  # of it depends how long a change of gains takes
def _preset(robot_model: str, *custom: tuple[str, ...]) -> Mapping[str, Any]:
    paths = zip(('custom_laws', 'custom_robots', 'custom_trajectories'), custom, strict=True)
    named = {'robot_model': robot_model, **dict(paths)}
    values = config.preset(named, load(named))
    laws = available(custom[0])
    groups = build_groups(values, of_laws(laws))
    return {name: groups.at(name, law.Gains) for name, law in laws.items()}


def changed(
    configuration: ControlConfiguration, changes: Mapping[str, Any]
) -> ControlConfiguration:
    """A configuration with another law, other gains or the preset.

    Args:
        configuration: The present configuration.
        changes: Key to value: ``law``, ``preset``, or ``<law>.<gain>``. ``preset: paper`` sets
            all gains.

    Raises:
        UnknownNameError: no such key or law.
        InputError: a value is wrong, or the theory of its law forbids the set of gains.
    """
    laws = configuration.laws
    for key in changes:
        name, _, gain = key.partition('.')
        if key not in ('law', 'preset') and gain not in _keys(laws.get(name)):
            known = [key for key, _ in settings(configuration)]
            raise UnknownNameError('parameter', key, known)
    paper = preset_of(configuration.loop)
    gains = dict(paper if changes.get('preset') == PRESET else configuration.gains)
    for name in {key.partition('.')[0] for key in changes} - {'law', 'preset'}:
        values = dict(_named(laws[name], gains[name]))
        start = f'{name}.'
        values |= {k.removeprefix(start): v for k, v in changes.items() if k.startswith(start)}
        gains[name] = fields.build(laws[name].Gains, values, start)
        judge(name, laws[name], gains[name])
    preset: Literal['paper', 'custom'] = 'paper' if gains == paper else 'custom'
    if changes.get('preset', preset) != preset:
        raise InputError(f'preset is {preset} with these gains, not {changes["preset"]!r}')
    loop = _with_law(configuration.loop, str(changes.get('law', configuration.loop.law)), laws)
    return configuration._replace(loop=loop._replace(preset=preset), gains=gains)


def settings(
    configuration: ControlConfiguration, before: ControlConfiguration | None = None
) -> Iterator[tuple[str, Any]]:
    """Keys and plain values of what can change while the controller runs.

    Args:
        configuration: The configuration.
        before: Another one; the gains that both share are left out.
    """
    yield 'law', configuration.loop.law
    yield 'preset', configuration.loop.preset
    for name, law in configuration.laws.items():
        if before is None or configuration.gains[name] is not before.gains[name]:
            for key, value in _named(law, configuration.gains[name]):
                yield f'{name}.{key}', value


def _keys(law: Law | None) -> list[str]:
    return [parameter.key for parameter in parameters(law.Gains)] if law else []


def _named(law: Law, gains: Any) -> Iterator[tuple[str, Any]]:
    for parameter, value in zip(parameters(law.Gains), gains, strict=True):
        yield parameter.key, plain(value)


def _with_law(loop: LoopParameters, law: str, laws: Mapping[str, Law]) -> LoopParameters:
    """The loop with an active law."""
    if law not in laws:
        raise UnknownNameError('law', law, laws, 'law')
    return loop._replace(law=law)
