"""Configuration of a controller: each group built and checked once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_base import config
from parallel_robot_base.arrays import Array
from parallel_robot_base.config import PRESET
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_base.fields import Field, build, parameters, plain
from parallel_robot_base.loop import LoopParameters, validate
from parallel_robot_base.placed import locating
from parallel_robot_control import law_loader
from parallel_robot_control.approach import ApproachParameters
from parallel_robot_control.contract import Law
from parallel_robot_control.delay_identification import LockInParameters
from parallel_robot_control.estimator import EstimatorParameters
from parallel_robot_control.laws import LAWS
from parallel_robot_control.prepared_law import judge
from parallel_robot_control.safety import SafetyParameters
from parallel_robot_model.robots import RobotModel, robot_of
from trajectory_gen.shapes import robot_and_shape_defaults, shapes_of
from trajectory_gen.trajectory import first_pose


class ControllerParameters(NamedTuple):
    """Parameters of the controller itself, besides robot and law."""

    guess: Annotated[
        tuple[float, ...],
        Field('', 'pose from which the first forward kinematics starts, as of the robot'),
    ]


class ControlConfiguration(NamedTuple):
    """Configuration of a controller.

    Attributes:
        loop: Period, joints, active law and the like.
        robot: Nominal robot.
        safety: Limits and the safe action.
        margins: SafetyMargins of the robot.
        guess: Pose from which the first forward kinematics starts, shape (m,).
        estimator: Where the motion of the joints is known from.
        lock_in: How the age of the states is identified, if it is.
        approach: How the robot joins the desired motion.
        laws: All laws by name.
        gains: Gains of each law.
        preset: Gains of each law in the preset.
    """

    loop: LoopParameters
    robot: RobotModel
    safety: SafetyParameters
    margins: Any
    guess: Array
    estimator: EstimatorParameters
    lock_in: LockInParameters
    approach: ApproachParameters
    laws: Mapping[str, Law]
    gains: Mapping[str, Any]
    preset: Mapping[str, Any]

    @property
    def custom(self) -> bool:
        """Whether the robot or a law is a custom one."""
        return bool(self.loop.custom_laws or self.loop.custom_robots)

    @property
    def joints(self) -> int:
        """Number of the actuated joints, n."""
        return len(self.loop.joints)


def custom_defaults(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults of the custom robot, laws and trajectories that a configuration names."""
    return robot_and_shape_defaults(values) | law_loader.default_gains(values)


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of custom modules; see :func:`config.resolve`."""
    return config.resolve(scenario, overrides, custom_defaults)


def available(values: Mapping[str, Any]) -> dict[str, Law]:
    """The laws of the suite and the custom laws of a resolved configuration, by name."""
    return LAWS | law_loader.custom_laws(values)


def configure(values: Mapping[str, Any]) -> ControlConfiguration:
    """Build the configuration of a controller from a resolved one.

    Raises:
        UnknownNameError: no such law.
        InputError: a value is wrong, or the theory of a law forbids its gains.
    """
    with locating(values):
        return _configured(values)


def _configured(values: Mapping[str, Any]) -> ControlConfiguration:
    robot = robot_of(values)
    laws = available(values)
    preset = config.preset(values, custom_defaults)
    gains = {name: config.group(values, law.Gains, name) for name, law in laws.items()}
    for name, law in laws.items():
        judge(name, law, gains[name])
    loop = validate(config.group(values, LoopParameters, ''))
    return ControlConfiguration(
        _with_law(loop, loop.law, laws),
        robot,
        config.group(values, SafetyParameters, 'safety'),
        config.group(values, robot.module.SafetyMargins, 'safety'),
        first_guess(values, robot),
        config.group(values, EstimatorParameters, 'estimator'),
        config.group(values, LockInParameters, 'lock_in'),
        config.group(values, ApproachParameters, 'approach'),
        laws,
        gains,
        {name: config.group(preset, law.Gains, name) for name, law in laws.items()},
    )


def first_guess(values: Mapping[str, Any], robot: RobotModel) -> Array:
    """The parameter ``controller.guess``, or the first pose of the trajectory, shape (m,).

    Where the file of a custom trajectory is not loaded, as for a bag, it is the initial pose.

    Raises:
        InputError: the parameter is not a pose.
    """
    given = list(config.group(values, ControllerParameters, 'controller').guess)
    if not given:
        if values['trajectory.shape'] in shapes_of(values):
            return first_pose(values)
        given = list(values['plant.initial_pose'])
    names = [axis.name for axis in robot.module.coordinates(robot.parameters)]
    if len(given) != len(names):
        raise InputError(
            f'controller.guess must be empty or [{", ".join(names)}], not {given}',
            'controller.guess',
        )
    return np.array(given)


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
    gains = dict(configuration.preset if changes.get('preset') == PRESET else configuration.gains)
    for name in {key.partition('.')[0] for key in changes} - {'law', 'preset'}:
        values = dict(_named(laws[name], gains[name]))
        start = f'{name}.'
        values |= {k.removeprefix(start): v for k, v in changes.items() if k.startswith(start)}
        gains[name] = build(laws[name].Gains, values, start)
        judge(name, laws[name], gains[name])
    preset: Literal['paper', 'custom'] = 'paper' if gains == configuration.preset else 'custom'
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
    """The loop with an active law.

    Raises:
        UnknownNameError: no such law.
    """
    if law not in laws:
        raise UnknownNameError('law', law, laws, 'law')
    return loop._replace(law=law)
