"""What calls the simulated robot outside Python: one period, its inputs and outputs in memory."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.compiler import (
    Boxed,
    KeptValue,
    Space,
    is_finite,
    keep,
    kernel,
    present,
    propose,
    read_at,
    write_at,
)
from parallel_robot_sim.configuration import Plant
from parallel_robot_sim.plant import PlantState, step
from parallel_robot_sim.sensors_actuators import effort_at_stamp, sensed

TORQUE, POSITION, VELOCITY, EFFORT, JOINTS, RATES = range(6)  # rows of numbers for each joint
ROWS = 6
AGE, POSE = 0, 1  # numbers behind them; the pose is the last


class PlantInstance(NamedTuple):
    """A simulated robot with its memory.

    Attributes:
        setup: What it is made of, see :class:`PlantSetup`.
        state: Its state, a KeptValue.
        like: A state, for its type.
        values: Address of inputs and outputs: ROWS for each joint, the age, the pose.
        period: Time between states [s].
    """

    setup: Any
    state: int
    like: PlantState
    values: int
    period: float


def plant_instance(plant: Plant, period: float, pose_size: int) -> Boxed:
    """A robot at rest at its start, boxed.

    Args:
        plant: The robot.
        period: Time between states [s].
        pose_size: Number of coordinates of a pose, m.
    """
    joints = len(plant.state.torque)
    values = Space(ROWS * joints + POSE + pose_size)
    return Boxed(PlantInstance(plant.setup, KeptValue(plant.state), plant.state, values, period))


@kernel
def tell_state(instance: PlantInstance) -> int:
    """Write the state to the outputs, as sensors tell it; 1 if the robot left its workspace."""
    state = present(instance.state, instance.like)
    setup, values, row = instance.setup, instance.values, state.torque
    true = setup.measure(setup.robot, state.coordinates, state.rate)
    angles, rates, effort, age = true.position, true.velocity, state.torque, 0.0
    if setup.imperfections.on:
        angles, rates = sensed(setup, true, state.time, instance.period)
        effort = effort_at_stamp(setup, state.torque, state.time, instance.period)
        age = setup.imperfections.age
    write_at(values, POSITION, angles)
    write_at(values, VELOCITY, rates)
    write_at(values, EFFORT, effort)
    write_at(values, JOINTS, true.position)
    write_at(values, RATES, true.velocity)
    first = ROWS * len(row)
    write_at(values, first + AGE, age)
    for k in range(len(true.pose)):
        write_at(values, first + POSE + k, true.pose[k])
    return 0 if is_finite(true.velocity) else 1


@kernel
def advance(instance: PlantInstance) -> int:
    """Move the robot by one period under the torque in the inputs; as :func:`tell_state`."""
    state = present(instance.state, instance.like)
    command = read_at(instance.values, TORQUE, np.zeros_like(state.torque))
    after = step(instance.setup, state, command, instance.period)
    propose(instance.state, after, instance.like)
    keep(instance.state)
    return tell_state(instance)
