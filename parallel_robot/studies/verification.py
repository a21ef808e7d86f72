"""The plants of the suite against MuJoCo, which shares nothing with them but the parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.registry import RobotModel, resolve, robot_of
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.mujoco_model import MujocoRobot
from parallel_robot_sim.plant_run import Simulator

if TYPE_CHECKING:
    from parallel_robot_sim.mujoco_machine import MujocoMachine

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
    'disturbance.amplitude': 0.0,
}


class Difference(NamedTuple):
    """The largest difference of the poses of a robot.

    Attributes:
        robot: Its number.
        largest: [m] or [rad], over the whole motion.
        path: Length of the motion of the pose, largest coordinate [m] or [rad].
    """

    robot: int
    largest: float
    path: float


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
    return [_compared(kind, base, number, seed, duration) for number in numbers]


def _compared(
    kind: str, base: Mapping[str, Any], number: int, seed: int, duration: float
) -> Difference:
    """Draw one robot and a motion until the motion stays in the workspace; compare the poses."""
    random = np.random.default_rng([seed, number])
    for _ in range(DRAWS):
        values = _drawn(kind, base, random)
        moved_by = torques(TORQUE[kind], len(values['joints']), duration, values, random)
        try:
            ours = poses(values, moved_by)
        except RunError:
            continue
        plant = MujocoRobot(*bodies(values))
        return difference(number, ours, mujoco_poses(plant, moved_by, values['period']))
    raise RunError(f'robot {number} of {kind}: no motion was found that stays in the workspace')


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


def poses(values: Mapping[str, Any], torques: Array) -> Array:
    """Poses of the suite's plant, shape (N + 1, m)."""
    plant = Simulator(configure_plant(values))
    found = [np.array(plant.pose)]
    for torque in torques:
        plant.advance(torque)
        found.append(np.array(plant.pose))
    return np.array(found)


def bodies(values: Mapping[str, Any]) -> tuple[RobotModel, Array, Sequence[float]]:
    """What MuJoCo builds a robot of: it, its initial pose, and its viscous friction."""
    robot = robot_of(values, 'true_robot')
    return robot, values['plant.initial_pose'], values['friction.viscous']


def mujoco_poses(plant: MujocoRobot | MujocoMachine, torques: Array, period: float) -> Array:
    """Poses of a robot in MuJoCo under torques, each held over a period, shape (N + 1, m)."""
    found = [plant.pose]
    for torque in torques:
        plant.advance(torque, period)
        found.append(plant.pose)
    return np.array(found)


def difference(number: int, ours: Array, theirs: Array) -> Difference:
    """How far two motions are apart, each of shape (N + 1, m)."""
    return Difference(
        number, float(np.abs(ours - theirs).max()), float(np.ptp(ours, axis=0).max())
    )
