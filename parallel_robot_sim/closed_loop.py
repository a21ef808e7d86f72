"""The closed loop as one compiled loop: reference in, complete record out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.arrays import Array
from parallel_robot_compiler import (
    FirstClass,
    kernel,
    read_row,
    write_row,
)
from parallel_robot_control.assembly import Control
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import ControlSetup, CycleState, When, cycle_of, is_finite
from parallel_robot_sim.assembly import Plant
from parallel_robot_sim.plant import PlantSetup, PlantState, step
from parallel_robot_sim.sensors import effort_at_stamp, sensed
from trajectory_gen.trajectory import Reference


class ClosedLoopRun(NamedTuple):
    """Complete record of a run, one row per state, shape (N, n) unless stated otherwise.

    Attributes:
        pose: True pose, shape (N, m).
        joints: Actuated joints as they are [rad].
        position: Actuated joints as they are measured [rad].
        velocity: Their measured rates [rad/s].
        passive_position: Passive joints [rad], shape (N, p).
        passive_velocity: Their rates [rad/s], shape (N, p).
        effort: Torque applied during the step that ended at the state [N m].
        command: Torque computed from the state [N m].
        sliding_variable: Sliding variable in the law's unit.
        coupled_error: e_c of the law [rad].
        fault: Fault of the controller at the state, see faults.py, shape (N,).
        acted: Bits of the limits that acted at the state, shape (N,).
        steps: Number of rows that were computed; fewer than N if the plant left its workspace.
        plant: State of the plant after the last command.
        cycle: State of the controller after the last row.
        memory: Memory of the law after the last row.
    """

    pose: Array
    joints: Array
    position: Array
    velocity: Array
    passive_position: Array
    passive_velocity: Array
    effort: Array
    command: Array
    sliding_variable: Array
    coupled_error: Array
    fault: NDArray[np.int64]
    acted: NDArray[np.int64]
    steps: int
    plant: PlantState
    cycle: CycleState
    memory: Any


class LoopState(NamedTuple):
    """State of the plant, state of the controller and memory of the law at one sample."""

    plant: PlantState
    cycle: CycleState
    memory: Any


def run(
    control: Control, plant: Plant, reference: Reference, period: float, complete: bool = True
) -> ClosedLoopRun:
    """Run the loop over all samples of a reference.

    Args:
        control: The controller before its first state.
        plant: The plant at its first state.
        reference: Desired motion, one sample per period.
        period: Time between samples [s].
        complete: Whether the record is to be complete; else it has what metrics are computed from:
            positions, efforts, faults and limits.
    """
    begin = LoopState(plant.state, control.state, control.law.memory)
    result: ClosedLoopRun = compiled_loop(
        cycle_of(control.setup, begin.cycle, begin.memory),
        FirstClass(step, plant.setup, begin.plant, begin.plant.torque, period),
        control.setup,
        plant.setup,
        reference,
        begin,
        complete,
        period,
    )
    return result


@kernel
def compiled_loop(
    run_cycle: Any,
    step: Any,
    control: ControlSetup,
    plant: PlantSetup,
    reference: Reference,
    begin: LoopState,
    complete: bool,
    period: float,
) -> ClosedLoopRun:
    """The loop of :func:`run`, with the kernels that it calls as FirstClass."""
    state, cycle_state, memory = begin
    row = state.torque
    # 1. Arrays for all rows; the robot gives the number of passive joints.
    first = plant.measure(plant.robot, state.coordinates, state.rate)
    count = len(reference.position)
    more = count if complete else 0
    joints = np.empty((count, len(row)))
    position = np.empty((count, len(row)))
    efforts = np.empty((count, len(row)))
    pose = np.empty((more, len(first.pose)))
    velocity = np.empty((more, len(row)))
    passive_position = np.empty((more, len(first.passive_position)))
    passive_velocity = np.empty((more, len(first.passive_velocity)))
    command = np.empty((more, len(row)))
    sliding_variable = np.empty((more, len(row)))
    coupled_error = np.empty((more, len(row)))
    fault = np.empty(count, np.int64)
    acted = np.empty(count, np.int64)
    steps = count
    for k in range(count):
        # 2. Measurement of state k; a robot that has left its workspace ends there.
        true = plant.measure(plant.robot, state.coordinates, state.rate)
        if not is_finite(true.velocity):
            steps = k
            break
        angles, rates, effort = true.position, true.velocity, state.torque
        if plant.imperfections.on:
            angles, rates = sensed(plant, true, state.time, period)
            effort = effort_at_stamp(plant, state.torque, state.time, period)
        # 3. The torque computed from it.
        desired = JointReference(
            read_row(reference.position, k, row),
            read_row(reference.velocity, k, row),
            read_row(reference.acceleration, k, row),
        )
        when = When(k, plant.imperfections.age, period)
        cycle = run_cycle(control, desired, angles, rates, effort, cycle_state, memory, when)
        write_row(joints, k, true.position)
        write_row(position, k, angles)
        write_row(efforts, k, state.torque)
        write_row(fault, k, cycle.state.fault)
        write_row(acted, k, cycle.acted)
        if complete:
            write_row(pose, k, true.pose)
            write_row(velocity, k, rates)
            write_row(command, k, cycle.torque)
            write_row(sliding_variable, k, cycle.sliding_variable)
            write_row(coupled_error, k, cycle.coupled_error)
            write_row(passive_position, k, true.passive_position)
            write_row(passive_velocity, k, true.passive_velocity)
        cycle_state = cycle.state
        memory = cycle.memory
        # 4. It acts until state k + 1.
        state = step(plant, state, cycle.torque, period)
    return ClosedLoopRun(
        pose,
        joints,
        position,
        velocity,
        passive_position,
        passive_velocity,
        efforts,
        command,
        sliding_variable,
        coupled_error,
        fault,
        acted,
        steps,
        state,
        cycle_state,
        memory,
    )
