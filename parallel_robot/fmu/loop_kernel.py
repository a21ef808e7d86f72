"""What calls a whole loop outside Python: law, robot and motion, one period after the other."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot.fmu import law_kernel, plant_kernel
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, kernel, read_at, read_row, write_at
from trajectory_gen.trajectory import Reference


class LoopInstance(NamedTuple):
    """A law, a simulated robot, and the motion that they follow.

    Attributes:
        law: The law, a boxed LawInstance.
        plant: The robot, a boxed PlantInstance.
        position: Desired positions, a row for each state, shape (N, n).
        velocity: Desired rates, shape (N, n).
        acceleration: Desired accelerations, shape (N, n).
    """

    law: Any
    plant: Any
    position: Array
    velocity: Array
    acceleration: Array


def loop_instance(law: Boxed, plant: Boxed, reference: Reference) -> Boxed:
    """A loop before its first state, boxed; arguments as the attributes of LoopInstance.

    After its last row, the reference stays there at rest.
    """
    values: Any = law.value.values
    joints = reference.position.shape[1]
    values.floats[law_kernel.ROWS * joints + law_kernel.EFFORT_KNOWN] = 1.0
    rest = np.zeros((1, joints))
    return Boxed(
        LoopInstance(
            law,
            plant,
            np.concatenate([reference.position, reference.position[-1:]]),
            np.concatenate([reference.velocity, rest]),
            np.concatenate([reference.acceleration, rest]),
        )
    )


@kernel
def begin_loop(instance: LoopInstance) -> int:
    """Tell the state of the robot and the first reference; 1 if the robot left its workspace."""
    _refer(instance)
    return plant_kernel.tell_state(instance.plant)


@kernel
def step_loop(instance: LoopInstance) -> int:
    """Answer the state, move the robot under the torque; as :func:`begin_loop`."""
    law, plant = instance.law, instance.plant
    row = law.like.held
    write_at(law.values, law_kernel.POSITION, read_at(plant.values, plant_kernel.POSITION, row))
    write_at(law.values, law_kernel.VELOCITY, read_at(plant.values, plant_kernel.VELOCITY, row))
    write_at(law.values, law_kernel.EFFORT, read_at(plant.values, plant_kernel.EFFORT, row))
    age = read_at(plant.values, plant_kernel.ROWS * len(row) + plant_kernel.AGE, 0.0)
    write_at(law.values, law_kernel.ROWS * len(row) + law_kernel.AGE, age)
    _refer(instance)
    law_kernel.answer_state(law)
    write_at(plant.values, plant_kernel.TORQUE, read_at(law.values, law_kernel.TORQUE, row))
    return plant_kernel.advance(plant)


@kernel
def _refer(instance: LoopInstance) -> None:
    """Write the reference of the state that the law answers next."""
    law, row = instance.law, instance.law.like.held
    number = law_kernel.ROWS * len(row) + law_kernel.SAMPLE
    k = min(int(read_at(law.values, number, 0.0)), len(instance.position) - 1)
    write_at(law.values, law_kernel.REFERENCE, read_row(instance.position, k, row))
    write_at(law.values, law_kernel.REFERENCE + 1, read_row(instance.velocity, k, row))
    write_at(law.values, law_kernel.REFERENCE + 2, read_row(instance.acceleration, k, row))
