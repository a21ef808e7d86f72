"""A described machine against MuJoCo's own model of its file, with random masses and motions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from parallel_robot.studies.robot_verification import values_of
from parallel_robot.studies.verification import (
    DRAWS,
    PLANT,
    SPREAD,
    Difference,
    bodies,
    difference,
    mujoco_poses,
    poses,
    torques,
)
from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.robots.described.default_values import at_home
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.mujoco_machine import MujocoMachine

POSE = 0.05  # of the length of the machine, or rad, about the initial pose
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
    return [_compared(given, base, machine, each, seed, duration) for each in numbers]


def _compared(
    given: Mapping[str, Any],
    base: Mapping[str, Any],
    machine: Machine,
    number: int,
    seed: int,
    duration: float,
) -> Difference:
    """Draw masses and a motion until the motion stays in the workspace; compare the poses."""
    random = np.random.default_rng([seed, number])
    inertia, gravity, _ = at_home(machine)
    units = np.where([unit == 'm' for unit in machine.units], machine.mechanism.length, 1.0)
    left = np.asarray(base['plant.torque_limit']) - np.abs(gravity)  # MuJoCo's motors have none
    largest = np.minimum(PUSH * inertia * units, left)
    for draw in range(DRAWS):
        values = _drawn(given, base, machine, random)
        push = 0.5 ** (draw // CALMER) * largest
        moved_by = gravity + torques(push, len(inertia), duration, base, random)
        try:
            ours = poses(values, moved_by)
            plant = MujocoMachine(*bodies(values))
        except RunError:
            continue
        except InputError as error:
            if error.key == 'plant.initial_pose':  # out of reach
                continue
            raise
        return difference(number, ours, mujoco_poses(plant, moved_by, base['period']))
    raise RunError(f'variant {number}: no motion was found that stays in the workspace')


def _drawn(
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
    spread = POSE * np.where(lengths, machine.mechanism.length, 1.0)
    pose = np.asarray(base['plant.initial_pose'])
    factor = np.broadcast_to(base['robot.mass_factor'], len(machine.names))
    changes = PLANT | {
        'robot.mass_factor': factor * (1.0 + SPREAD * random.uniform(-1.0, 1.0, factor.shape)),
        'robot.payload': SPREAD * machine.mechanism.mass.max() * random.uniform(),
        'plant.initial_pose': pose + spread * random.uniform(-1.0, 1.0, pose.shape),
        'friction.viscous': inertia * random.uniform(*DAMPING, inertia.shape),
    }
    return values_of(merged([given, changes]))
