"""The kernels of an FMU: a law, a plant, and both in a loop."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.assembly import Control
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import before_cycle, run_cycle
from parallel_robot_control.safety.faults import NONE, STATES_STALE
from parallel_robot_control.safety.limiting import OVERDUE, When
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    Boxed,
    FloatBuffer,
    Struct,
    is_finite,
    kernel,
    read_at,
    read_row,
    select,
    write_at,
)
from parallel_robot_sim.configuration import Plant
from parallel_robot_sim.plant import observe, step
from trajectory_gen.trajectory import Reference

# What a controller outside Python calls: one control cycle, its inputs and outputs in memory.

# Rows of numbers for each joint,
POSITION, VELOCITY, EFFORT, REFERENCE, TORQUE = 0, 1, 2, 3, 6
SLIDING_VARIABLE, COUPLED_ERROR = 7, 8
ROWS = 9  # the reference has three
# and numbers behind them.
(
    AGE, EFFORT_KNOWN, JOINS, SAMPLE, FAULT, CAUSE, ACTED, ELAPSED, STATE_TIMEOUT, REFERENCE_AGE,
    WAITS,
) = range(11)  # fmt: skip
NUMBERS = 11
FOREVER = 1e9  # s
PAUSE = 1.5  # periods from a state to the next, above which states between them are missing


class LawInstance(NamedTuple):
    """A controller with its memory."""

    setup: Any  # law, robot and limits, see :class:`ControlSetup`
    values: int  # address of inputs and outputs: ROWS for each joint, then NUMBERS
    period: float  # time between states [s]


def law_instance(control: Control, period: float, state_timeout: float) -> Boxed:
    """A controller before its first state, boxed.

    Args:
        control: The controller; its law has an empty memory.
        period: Time between states [s].
        state_timeout: Time without states that is a fault [s].
    """
    control.law.reset_memory()
    joints = len(control.state.fault_position)
    values = FloatBuffer(ROWS * joints + NUMBERS)
    values.floats[ROWS * joints + FAULT] = control.state.fault
    values.floats[ROWS * joints + STATE_TIMEOUT] = state_timeout
    control.setup.memory.state.value = control.state
    return Boxed(LawInstance(control.setup, values, period))


@kernel
def begin_law(instance: LawInstance) -> int:
    """Nothing: a law has no outputs before its first state."""
    return 0


@kernel
def answer_state(instance: LawInstance) -> int:
    """Compute the torque for the state in the inputs; 0."""
    values, state = instance.values, instance.setup.memory.state
    row = state.fault_position
    first = ROWS * len(row)
    desired = JointReference(
        read_at(values, REFERENCE, row),
        read_at(values, REFERENCE + 1, row),
        read_at(values, REFERENCE + 2, row),
    )
    known = read_at(values, first + EFFORT_KNOWN, 0.0) != 0.0
    effort = select(known, read_at(values, EFFORT, row), np.zeros_like(row) + np.nan)
    sample, dt = int(read_at(values, first + SAMPLE, 0.0)), instance.period
    elapsed = min(read_at(values, first + ELAPSED, 0.0), FOREVER)
    torque, cause = state.torque, NONE
    overdue = read_at(values, first + REFERENCE_AGE, 0.0) > OVERDUE
    joins = read_at(values, first + WAITS, 0.0) != 0.0 and not overdue
    if sample == 0 and read_at(values, first + JOINS, 0.0) != 0.0:  # it goes on from what acts
        torque, joins = select(effort - effort == 0.0, effort, torque), True
    if sample > 0 and elapsed > PAUSE * dt:
        sample, dt = sample + int(elapsed / dt + 0.5) - 1, elapsed
        if elapsed > read_at(values, first + STATE_TIMEOUT, 0.0):
            torque, cause = np.zeros_like(row), STATES_STALE
    before_cycle(state, torque, cause, joins)
    cycle = run_cycle(
        instance.setup,
        desired,
        read_at(values, POSITION, row),
        read_at(values, VELOCITY, row),
        effort,
        When(sample, read_at(values, first + AGE, 0.0), dt),
    )
    write_at(values, TORQUE, cycle.torque)
    write_at(values, SLIDING_VARIABLE, cycle.telemetry.sliding_variable)
    write_at(values, COUPLED_ERROR, cycle.telemetry.coupled_error)
    write_at(values, first + SAMPLE, float(sample + 1))
    write_at(values, first + WAITS, select(overdue, 1.0, 0.0))
    write_at(values, first + FAULT, float(state.fault))
    write_at(values, first + CAUSE, float(cycle.cause))
    write_at(values, first + ACTED, float(cycle.active_limits))
    return 0


# What calls the simulated robot outside Python: one period, its inputs and outputs in memory.

# Rows of numbers for each joint,
PLANT_TORQUE, PLANT_POSITION, PLANT_VELOCITY, PLANT_EFFORT, JOINTS, RATES = range(6)
PLANT_ROWS = 6
PLANT_AGE, POSE = 0, 1  # and numbers behind them; the pose is the last


class PlantInstance(NamedTuple):
    """A simulated robot with its memory."""

    setup: Any  # what it is made of, see :class:`PlantSetup`
    state: Any  # PlantState, a Struct
    values: int  # address of inputs and outputs: PLANT_ROWS for each joint, the age, the pose
    period: float  # time between states [s]


def plant_instance(plant: Plant, period: float, pose_size: int) -> Boxed:
    """A robot at rest at its start, boxed.

    Args:
        plant: The robot.
        period: Time between states [s].
        pose_size: Number of coordinates of a pose, m.
    """
    joints = len(plant.state.torque)
    values = FloatBuffer(PLANT_ROWS * joints + POSE + pose_size)
    return Boxed(PlantInstance(plant.setup, Struct(plant.state), values, period))


@kernel
def tell_state(instance: PlantInstance) -> int:
    """Write the state to the outputs, as sensors tell it; 1 if the robot left its workspace."""
    state = instance.state.value
    setup, values, row = instance.setup, instance.values, state.torque
    seen = observe(setup, state, 0, instance.period, True)
    true, age = seen.true, 0.0
    if setup.imperfections.on:
        age = setup.imperfections.age
    write_at(values, PLANT_POSITION, seen.position)
    write_at(values, PLANT_VELOCITY, seen.velocity)
    write_at(values, PLANT_EFFORT, seen.effort)
    write_at(values, JOINTS, true.position)
    write_at(values, RATES, true.velocity)
    first = PLANT_ROWS * len(row)
    write_at(values, first + PLANT_AGE, age)
    for k in range(len(true.pose)):
        write_at(values, first + POSE + k, true.pose[k])
    return 0 if is_finite(true.velocity) else 1


@kernel
def advance(instance: PlantInstance) -> int:
    """Move the robot by one period under the torque in the inputs; as :func:`tell_state`."""
    state = instance.state.value
    command = read_at(instance.values, PLANT_TORQUE, np.zeros_like(state.torque))
    after = step(instance.setup, state, command, instance.period)
    instance.state.value = after
    return tell_state(instance)


# What calls a whole loop outside Python: law, robot and motion, one period after the other.


class LoopInstance(NamedTuple):
    """A law, a simulated robot, and the motion that they follow."""

    law: Any  # the law, a boxed LawInstance
    plant: Any  # the robot, a boxed PlantInstance
    position: Array  # desired positions, a row for each state, shape (N, n)
    velocity: Array  # desired rates, shape (N, n)
    acceleration: Array  # desired accelerations, shape (N, n)


def loop_instance(law: Boxed, plant: Boxed, reference: Reference) -> Boxed:
    """A loop before its first state, boxed; arguments as the attributes of LoopInstance.

    After its last row, the reference stays there at rest.
    """
    values: Any = law.value.values
    joints = reference.position.shape[1]
    values.floats[ROWS * joints + EFFORT_KNOWN] = 1.0
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
    return tell_state(instance.plant)


@kernel
def step_loop(instance: LoopInstance) -> int:
    """Answer the state, move the robot under the torque; as :func:`begin_loop`."""
    law, plant = instance.law, instance.plant
    row = law.setup.memory.state.fault_position
    write_at(law.values, POSITION, read_at(plant.values, PLANT_POSITION, row))
    write_at(law.values, VELOCITY, read_at(plant.values, PLANT_VELOCITY, row))
    write_at(law.values, EFFORT, read_at(plant.values, PLANT_EFFORT, row))
    age = read_at(plant.values, PLANT_ROWS * len(row) + PLANT_AGE, 0.0)
    write_at(law.values, ROWS * len(row) + AGE, age)
    _refer(instance)
    answer_state(law)
    write_at(plant.values, PLANT_TORQUE, read_at(law.values, TORQUE, row))
    return advance(plant)


@kernel
def _refer(instance: LoopInstance) -> None:
    """Write the reference of the state that the law answers next."""
    law, row = instance.law, instance.law.setup.memory.state.fault_position
    number = ROWS * len(row) + SAMPLE
    k = min(int(read_at(law.values, number, 0.0)), len(instance.position) - 1)
    write_at(law.values, REFERENCE, read_row(instance.position, k, row))
    write_at(law.values, REFERENCE + 1, read_row(instance.velocity, k, row))
    write_at(law.values, REFERENCE + 2, read_row(instance.acceleration, k, row))
