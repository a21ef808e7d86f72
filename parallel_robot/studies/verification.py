"""Plants against MuJoCo, which shares parameters with them, and robots against their contract."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.studies import file_in_engine
from parallel_robot.studies.file_in_engine import Compared
from parallel_robot_control.configuration import resolve as resolve_control
from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.robots.described.default_values import at_home
from parallel_robot_model.robots.registry import (
    KERNELS,
    load_robots,
    resolve,
    robot_of,
)
from parallel_robot_model.robots.robot_checks import RATE, Check, checks
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.mujoco_machine import MujocoMachine
from parallel_robot_sim.mujoco_model import MujocoRobot
from parallel_robot_sim.plant_run import Simulator

SCENARIOS = {'planar_3rrr': 'paper_circle', 'serial_2r': 'serial_2r_circle', 'axes': 'axes_step'}
UNCERTAIN = ('m1', 'm2', 'mp', 'I1', 'I2', 'Ip', 'lc1', 'lc2', 'inertia')
SPREAD = 0.2  # of the parameters, relative
POSE = {  # m, rad, about that of the scenario
    'planar_3rrr': np.array([0.04, 0.04, 0.3]),
    'serial_2r': np.array([0.05, 0.05]),
    'axes': np.ones(1),
}
TORQUE = {'planar_3rrr': 1.5, 'serial_2r': 1.5, 'axes': 1.0}  # N m, amplitude
FREQUENCY = 1.0, 4.0  # Hz
VISCOUS = 1.0, 3.0  # N m s/rad
DRAWS = 50  # of one robot, until its motion stays in the workspace
PLANT = {  # as exact as MuJoCo's integration
    'plant.integrator': 'rk4',
    'plant.substeps': 10,
    'friction.coulomb': 0.0,
    'friction.stribeck': 0.0,
    'friction.offset': 0.0,
    'friction.load': 0.0,
    'disturbance.amplitude': 0.0,
}


class Difference(NamedTuple):
    """The largest difference of the poses of a robot."""

    robot: int  # its number
    largest: float  # [m] or [rad], over the whole motion
    path: float  # length of the motion of the pose, largest coordinate [m] or [rad]


def check_numbers(robots: int, seed: int, duration: float, before: str = '') -> None:
    """Refuse numbers with which nothing can be compared.

    Args:
        robots: Robots of each kind.
        seed: Of all that is random.
        duration: Of each motion [s].
        before: What stands before their names in messages.

    Raises:
        InputError: one is wrong.
    """
    if not isinstance(robots, int) or robots < 1:
        raise InputError(f'{before}robots must be at least 1, not {robots}')
    if not isinstance(seed, int) or seed < 0:
        raise InputError(f'{before}seed must not be negative, not {seed}')
    if not 0.001 <= duration <= 10.0:
        raise InputError(f'{before}duration must be 0.001 to 10 s, not {duration:g}')


def verify(kind: str, numbers: Iterable[int], seed: int, duration: float) -> list[Difference]:
    """Compare random robots of a kind, each from a random pose under random torques.

    Args:
        kind: Key of SCENARIOS.
        numbers: Numbers of the robots; one of the same number and seed is the same.
        seed: Of all that is random.
        duration: Of each motion [s].

    Raises:
        InputError: MuJoCo is not installed.
        RunError: no motion was found that stays in the workspace.
    """
    base = resolve(SCENARIOS[kind])

    def drawn(random: np.random.Generator, _: int) -> tuple[dict[str, Any], Array]:
        values = _drawn(kind, base, random)
        return values, torques(TORQUE[kind], len(values['joints']), duration, values, random)

    what = f'robot {{}} of {kind}'
    return [_compared(what, drawn, MujocoRobot, number, seed) for number in numbers]


def _compared(
    what: str,
    drawn: Callable[[np.random.Generator, int], tuple[dict[str, Any], Array]],
    model: type[MujocoRobot | MujocoMachine],
    number: int,
    seed: int,
) -> Difference:
    """Draw one robot and a motion until the motion stays in the workspace; compare the poses."""
    random = np.random.default_rng([seed, number])
    for draw in range(DRAWS):
        values, moved_by = drawn(random, draw)
        try:
            plant = Simulator(configure_plant(values))
            ours = _poses(plant, moved_by, ())
            robot, pose = robot_of(values, 'true_robot'), values['plant.initial_pose']
            other = model(robot, pose, values['friction.viscous'])
        except RunError:
            continue
        except InputError as error:
            if error.key == 'plant.initial_pose':  # out of reach
                continue
            raise
        theirs = _poses(other, moved_by, (values['period'],))
        apart, path = np.abs(ours - theirs).max(), np.ptp(ours, axis=0).max()
        return Difference(number, float(apart), float(path))
    raise RunError(f'{what.format(number)}: no motion was found that stays in the workspace')


def _drawn(kind: str, base: Mapping[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """A configuration with a random robot at a random pose."""
    changes: dict[str, Any] = dict(PLANT)
    for name in UNCERTAIN:
        key = f'robot.{name}'
        if key in base:
            factor = 1.0 + SPREAD * random.uniform(-1.0, 1.0, np.shape(base[key]))
            changes[key] = factor * base[key]
    pose = np.asarray(base['plant.initial_pose'])
    changes['plant.initial_pose'] = pose + random.uniform(-1.0, 1.0, pose.shape) * POSE[kind]
    changes['friction.viscous'] = random.uniform(*VISCOUS, len(base['joints']))
    return resolve(SCENARIOS[kind], changes)


def torques(
    amplitude: Array | float,
    joints: int,
    duration: float,
    values: Mapping[str, Any],
    random: np.random.Generator,
) -> Array:
    """A sine for each joint [N m], one row for each period."""
    time = np.arange(round(duration / values['period']))[:, None] * values['period']
    frequency, phase = random.uniform(*FREQUENCY, joints), random.uniform(0.0, 2 * math.pi, joints)
    return amplitude * np.sin(2.0 * math.pi * frequency * time + phase)


def _poses(plant: Any, torques: Array, period: tuple[float, ...]) -> Array:
    """Poses of a plant under torques, each held over a period, shape (N + 1, m)."""
    found = [np.array(plant.pose)]
    for torque in torques:
        plant.advance(torque, *period)
        found.append(np.array(plant.pose))
    return np.array(found)


# One robot against its contract: whether its functions describe one machine.

STATES = 20  # the first at the initial pose
SPREAD_OF_STATES = 0.02  # m or rad, of the poses about it


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
    configuration = configure_plant(values_of(given))
    robot, margins = configuration.true_robot, configuration.margins
    centre = np.array(robot.pose_of('plant.initial_pose', configuration.plant.initial_pose))
    random = np.random.default_rng(seed)
    worst: dict[tuple[str, str], Check] = {}
    for k in range(STATES):
        pose = centre + (
            random.uniform(-SPREAD_OF_STATES, SPREAD_OF_STATES, len(centre)) if k else 0.0
        )
        rate = random.uniform(-RATE, RATE, len(centre))
        try:
            found = [*checks(robot, configuration.joint_load, pose, rate, margins)]
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


def verify_file(given: Mapping[str, Any], path: Path, seed: int) -> tuple[str, list[Compared]]:
    """Hold a described machine against what an engine makes of its file.

    Args:
        given: Keys of the configuration and their values, robot_model, too.
        path: The file.
        seed: Of postures and rates.

    Returns:
        What it was held against, or why it was not; of each quantity the largest difference.

    Raises:
        InputError: a value is wrong.
    """
    robot = robot_of(values_of(given))
    try:
        engine, found = file_in_engine.compare(robot, path, seed)
    except InputError as error:
        return f'not compared with an engine: {error}', []
    return f'{engine}, {file_in_engine.POSTURES} postures near home', found


def values_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration of one robot from what is given of it.

    Raises:
        InputError: a value is wrong.
    """
    scenario = SCENARIOS.get(str(given.get('robot_model')), 'paper_circle')
    own = load_robots(given).defaults({'robot_model': '', **given})  # of its poses, say
    return resolve_control(scenario, merged([own, given]))


# A described machine against MuJoCo's own model of its file, with random masses and motions.

POSE_SPREAD = 0.05  # of the length of the machine, or rad, about the initial pose
PUSH = 10.0  # rad/s^2 or lengths/s^2, amplitude of the torques over the inertia
CALMER = 10  # draws after which it is halved: not every machine has room for it
DAMPING = 3.0, 6.0  # 1/s, viscous friction over the inertia


def name_of(given: Mapping[str, Any]) -> str:
    """Name of a described machine.

    Args:
        given: Keys of the configuration and their values, robot_model, too.

    Raises:
        InputError: a value is wrong, or the robot is none.
    """
    robot = robot_of(values_of(given))
    if not hasattr(robot.module, 'machine'):
        raise InputError(
            f'{robot.name} is not described by a file: without --set, robots of each kind are '
            'compared with MuJoCo'
        )
    return robot.name


def verify_machine(
    given: Mapping[str, Any], numbers: Iterable[int], seed: int, duration: float
) -> list[Difference]:
    """Compare a machine with random masses, each time from a random pose under random torques.

    Args:
        given: Keys of the configuration and their values, robot_model, too.
        numbers: Numbers of the variants; one of the same number and seed is the same.
        seed: Of all that is random.
        duration: Of each motion [s].

    Raises:
        InputError: MuJoCo is not installed, or the description is not MJCF.
        RunError: no motion was found that stays in the workspace.
    """
    base = values_of(given)
    robot = robot_of(base)
    module: Any = robot.module
    machine = module.machine(robot.parameters)
    inertia, gravity, _ = at_home(machine)
    units = np.where([unit == 'm' for unit in machine.units], machine.mechanism.length, 1.0)
    left = np.asarray(base['plant.torque_limit']) - np.abs(gravity)  # MuJoCo's motors have none
    largest = np.minimum(PUSH * inertia * units, left)

    def drawn(random: np.random.Generator, draw: int) -> tuple[dict[str, Any], Array]:
        values = _drawn_machine(given, base, machine, random)
        push = 0.5 ** (draw // CALMER) * largest
        return values, gravity + torques(push, len(inertia), duration, base, random)

    return [_compared('variant {}', drawn, MujocoMachine, each, seed) for each in numbers]


def _drawn_machine(
    given: Mapping[str, Any],
    base: Mapping[str, Any],
    machine: Machine,
    random: np.random.Generator,
) -> dict[str, Any]:
    """A configuration with random masses, friction and pose."""
    inertia, _, _ = at_home(machine)
    lengths = [unit == 'm' for _, unit in machine.coordinates] or [
        unit == 'm' for unit in machine.units
    ]
    spread = POSE_SPREAD * np.where(lengths, machine.mechanism.length, 1.0)
    pose = np.asarray(base['plant.initial_pose'])
    factor = np.broadcast_to(base['robot.mass_factor'], len(machine.names))
    changes = PLANT | {
        'robot.mass_factor': factor * (1.0 + SPREAD * random.uniform(-1.0, 1.0, factor.shape)),
        'robot.payload': SPREAD * machine.mechanism.mass.max() * random.uniform(),
        'plant.initial_pose': pose + spread * random.uniform(-1.0, 1.0, pose.shape),
        'friction.viscous': inertia * random.uniform(*DAMPING, inertia.shape),
    }
    return values_of(merged([given, changes]))
