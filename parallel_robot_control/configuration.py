"""From a configuration to its controller: robot, limits, laws and their gains."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_control import law_loader
from parallel_robot_control.approach import ApproachParameters
from parallel_robot_control.contract import Law
from parallel_robot_control.estimation.estimator import EstimatorParameters
from parallel_robot_control.estimation.lock_in import LockInParameters
from parallel_robot_control.laws import LAWS
from parallel_robot_control.prepared_law import validate_gains
from parallel_robot_control.repetition import RepetitionParameters, repetition_samples_of
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import config, fields
from parallel_robot_model.configuration.config import PRESET, Modules
from parallel_robot_model.configuration.fields import (
    Declared,
    Field,
    Groups,
    declared_in,
    defaults,
    grouped,
    parameters,
    plain,
)
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen import configuration as motion
from trajectory_gen.configuration import INITIAL, MotionConfiguration


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


class ControlConfiguration(MotionConfiguration):
    """Laws and gains, and all that a controller is made of."""

    controller = grouped('controller', ControllerParameters)
    estimator = grouped('estimator', EstimatorParameters)
    lock_in = grouped('lock_in', LockInParameters)
    approach = grouped('approach', ApproachParameters)
    repetition = grouped('repetition', RepetitionParameters)
    safety = grouped('safety', SafetyParameters)

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """All laws by name."""
        with with_location(self.values):
            return available(self.loop.custom_laws)

    @cached_property
    def gains(self) -> Mapping[str, Any]:
        """Gains of each law, which its theory allows."""
        gains = {name: self.at(name, law.Gains) for name, law in self.laws.items()}
        with with_location(self.values):
            for name, law in self.laws.items():
                validate_gains(name, law, gains[name])
        return gains

    @property
    def margins(self) -> Any:
        """SafetyMargins of the robot."""
        return self.at('safety', self.module.SafetyMargins)

    @cached_property
    def guess(self) -> tuple[float, ...]:
        """Pose from which the first forward kinematics starts, m numbers.

        The parameter ``controller.guess``, or the first pose of the motion. Where the file of a
        custom trajectory is not loaded, as for a bag, it is the initial pose.
        """
        with with_location(self.values):
            if self.controller.guess:
                return checked(self.controller.guess, self.robot)
            if self.values['trajectory.shape'] not in self.shapes:
                return checked(tuple(map(float, self.values[INITIAL])), self.robot)
            self.check_motion()
            return checked(self.trajectory.first_pose, self.robot)

    @cached_property
    def repetition_samples(self) -> int:
        """Samples of a turn; 0 where nothing is learned."""
        if not self.repetition.gain:
            return 0
        with with_location(self.values):
            return repetition_samples_of(self.repetition, self.trajectory, self.loop.period)

    @property
    def made_of(self) -> tuple[Any, ...]:
        """What a controller depends on."""
        groups = self.controller, self.estimator, self.lock_in, self.approach, self.repetition
        made = self.robot, self.margins, self.guess, self.repetition_samples, self.gains
        return self.loop, self.safety, *groups, *made

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

    def check_control(self) -> None:
        """Find what is wrong in the parameters of the controller and of all laws.

        Raises:
            UnknownNameError: no such law.
            InputError: a value is wrong, the theory of a law forbids its gains, the guess is no
                pose, or a motion of which is learned does not repeat.
        """
        self.check(declared(self.robot.module, self.laws))
        with with_location(self.values):
            _with_law(self.loop, self.loop.law, self.laws)
        _ = self.gains, self.guess, self.repetition_samples


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
    yield from declared_in(ControlConfiguration)
    yield 'safety', robot.SafetyMargins
    yield from of_laws(laws)


def configure(values: Mapping[str, Any]) -> ControlConfiguration:
    """Build the configuration of a controller from a resolved one.

    Raises:
        UnknownNameError: no such law.
        InputError: a value is wrong, or the theory of a law forbids its gains.
    """
    configuration = ControlConfiguration(values)
    configuration.check_control()
    return configuration


def nominal_of(values: Mapping[str, Any]) -> tuple[RobotModel, Array]:
    """The nominal robot of a resolved configuration, and where its forward kinematics starts.

    Returns:
        The robot; the parameter ``controller.guess``, or the first pose of the trajectory,
        shape (m,).

    Raises:
        InputError: a parameter is wrong.
    """
    configuration = ControlConfiguration(values)
    return configuration.robot, np.array(configuration.guess)


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
    groups = Groups(values)
    return {name: groups.at(name, law.Gains) for name, law in available(custom[0]).items()}


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
        validate_gains(name, laws[name], gains[name])
    preset: Literal['paper', 'custom'] = 'paper' if gains == paper else 'custom'
    if changes.get('preset', preset) != preset:
        raise InputError(f'preset is {preset} with these gains, not {changes["preset"]!r}')
    loop = _with_law(configuration.loop, str(changes.get('law', configuration.loop.law)), laws)
    return configuration.with_parts(loop=loop._replace(preset=preset), gains=gains)


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
