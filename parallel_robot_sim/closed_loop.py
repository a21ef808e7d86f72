"""The closed loop as one compiled loop: reference in, complete record out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.function_value import FirstClass
from parallel_robot_base.kernel import kernel
from parallel_robot_control.assembly import Control
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import ControlSetup, CycleState, cycle_of, is_finite
from parallel_robot_sim.assembly import Plant
from parallel_robot_sim.plant import PlantSetup, PlantState, step
from trajectory_gen.trajectory import Reference

Array = NDArray[np.float64]


class ClosedLoopRun(NamedTuple):
    """Complete record of a run, one row per state, shape (N, n) unless stated otherwise.

    Attributes:
        pose: True pose, shape (N, m).
        position: Actuated joints [rad].
        velocity: Their rates [rad/s].
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


def run(control: Control, plant: Plant, reference: Reference, period: float) -> ClosedLoopRun:
    """Run the loop over all samples of a reference.

    Args:
        control: The controller before its first state.
        plant: The plant at its first state.
        reference: Desired motion, one sample per period.
        period: Time between samples [s].
    """
    begin = LoopState(plant.state, control.state, control.law.memory)
    row = np.zeros(reference.position.shape[1])
    result: ClosedLoopRun = compiled_loop(
        cycle_of(control.setup, begin.cycle, begin.memory),
        FirstClass(step, plant.setup, begin.plant, row, period),
        control.setup,
        plant.setup,
        reference,
        begin,
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
    period: float,
) -> ClosedLoopRun:
    """The loop of :func:`run`, with the kernels that it calls as FirstClass."""
    state, cycle_state, memory = begin
    # 1. Arrays for all rows; the robot gives the number of passive joints.
    first = plant.measure(plant.robot, state.coordinates, state.rate)
    count, n = reference.position.shape
    m, p = len(first.pose), len(first.passive_position)
    pose = np.empty((count, m))
    position = np.empty((count, n))
    velocity = np.empty((count, n))
    passive_position = np.empty((count, p))
    passive_velocity = np.empty((count, p))
    effort = np.empty((count, n))
    command = np.empty((count, n))
    sliding_variable = np.empty((count, n))
    coupled_error = np.empty((count, n))
    fault = np.empty(count, dtype=np.int64)
    acted = np.empty(count, dtype=np.int64)
    steps = count
    for k in range(count):
        # 2. Measurement of state k; stop once the robot has left its workspace.
        joints = plant.measure(plant.robot, state.coordinates, state.rate)
        if not is_finite(joints.velocity):
            steps = k
            break
        # 3. The torque computed from it.
        desired = JointReference(
            reference.position[k], reference.velocity[k], reference.acceleration[k]
        )
        cycle = run_cycle(
            control, desired, joints.position, joints.velocity, cycle_state, memory, period
        )
        for i in range(m):  # element by element: rows as a whole compile to far more code
            pose[k, i] = joints.pose[i]
        for i in range(n):
            position[k, i] = joints.position[i]
            velocity[k, i] = joints.velocity[i]
            effort[k, i] = state.torque[i]
            command[k, i] = cycle.torque[i]
            sliding_variable[k, i] = cycle.sliding_variable[i]
            coupled_error[k, i] = cycle.coupled_error[i]
        for i in range(p):
            passive_position[k, i] = joints.passive_position[i]
            passive_velocity[k, i] = joints.passive_velocity[i]
        fault[k] = cycle.state.fault
        acted[k] = cycle.acted
        cycle_state = cycle.state
        memory = cycle.memory
        # 4. It acts until state k + 1.
        state = step(plant, state, cycle.torque, period)
    return ClosedLoopRun(
        pose,
        position,
        velocity,
        passive_position,
        passive_velocity,
        effort,
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
