"""The closed loop as one compiled loop: reference in, everything that happened out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.function_value import FirstClass
from parallel_robot_base.kernel import kernel
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import CycleState, cycle_of, is_finite
from parallel_robot_control.safety import Limits
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_sim.disturbance import DisturbanceParameters
from parallel_robot_sim.friction import FrictionParameters
from parallel_robot_sim.plant import PlantState, Stepping, measure, step
from trajectory_gen.trajectory import Reference

Array = NDArray[np.float64]


class ClosedLoopRun(NamedTuple):
    """Everything that happened, one row a state, each shape (N, 3) unless said otherwise.

    Attributes:
        pose: True pose [m, m, rad].
        theta: Actuated angles [rad].
        theta_dot: Actuated rates [rad/s].
        psi: Passive angles [rad].
        psi_dot: Passive rates [rad/s].
        effort: Torque applied during the step that ended at the state [N m].
        command: Torque computed from the state [N m].
        sliding_variable: In the law's unit.
        coupled_error: e_c of the law [rad].
        fault: What the controller is in at the state, a key of FAULT_TEXT, shape (N,).
        acted: Bits of the limits that acted at the state, shape (N,).
        steps: Number of rows that were computed; fewer than N when the plant left its workspace.
        plant: State of the plant after the last command.
        cycle: State of the controller after the last row.
        memory: Memory of the law after the last row.
    """

    pose: Array
    theta: Array
    theta_dot: Array
    psi: Array
    psi_dot: Array
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


def run(
    update: Any,
    gains: Any,
    nominal: RobotParameters,
    limits: Limits,
    reference: Reference,
    plant: Stepping,
    robot: RobotParameters,
    friction: FrictionParameters,
    disturbance: DisturbanceParameters,
    state: PlantState,
    cycle_state: CycleState,
    memory: Any,
    period: float,
) -> ClosedLoopRun:
    """Run the loop over all samples of a reference.

    Args:
        update: The law, as FirstClass.
        gains: Its gains.
        nominal: Robot as the controller believes it to be.
        limits: What the controller never exceeds.
        reference: Desired motion, one sample a period.
        plant: Integration and motors.
        robot: True robot.
        friction: Friction of the true robot.
        disturbance: Disturbance of the true robot.
        state: State 0 of the plant.
        cycle_state: State 0 of the controller.
        memory: Memory of the law before the first update.
        period: [s].

    Returns:
        The run.
    """
    row = np.zeros(3)
    result: ClosedLoopRun = compiled_loop(
        cycle_of(update, gains, nominal, limits, cycle_state, memory),
        FirstClass(step, plant, robot, friction, disturbance, state, row, period),
        FirstClass(measure, robot, state),
        update,
        gains,
        nominal,
        limits,
        reference,
        plant,
        robot,
        friction,
        disturbance,
        state,
        cycle_state,
        memory,
        period,
    )
    return result


@kernel
def compiled_loop(
    run_cycle: Any,
    step: Any,
    measure: Any,
    update: Any,
    gains: Any,
    nominal: RobotParameters,
    limits: Limits,
    reference: Reference,
    plant: Stepping,
    robot: RobotParameters,
    friction: FrictionParameters,
    disturbance: DisturbanceParameters,
    state: PlantState,
    cycle_state: CycleState,
    memory: Any,
    period: float,
) -> ClosedLoopRun:
    """The loop of :func:`run`, with the kernels that it calls as FirstClass."""
    count = len(reference.position)
    pose = np.empty((count, 3))
    theta = np.empty((count, 3))
    theta_dot = np.empty((count, 3))
    psi = np.empty((count, 3))
    psi_dot = np.empty((count, 3))
    effort = np.empty((count, 3))
    command = np.empty((count, 3))
    sliding_variable = np.empty((count, 3))
    coupled_error = np.empty((count, 3))
    fault = np.empty(count, dtype=np.int64)
    acted = np.empty(count, dtype=np.int64)
    steps = count
    for k in range(count):
        measurement = measure(robot, state)
        if not is_finite(measurement.theta_dot):
            steps = k
            break
        desired = JointReference(
            reference.position[k], reference.velocity[k], reference.acceleration[k]
        )
        cycle = run_cycle(
            update,
            gains,
            nominal,
            limits,
            desired,
            measurement.theta,
            measurement.theta_dot,
            cycle_state,
            memory,
            period,
        )
        for i in range(3):  # rows as a whole would need a text for each error of their shapes
            pose[k, i] = state.pose[i]
            theta[k, i] = measurement.theta[i]
            theta_dot[k, i] = measurement.theta_dot[i]
            psi[k, i] = measurement.psi[i]
            psi_dot[k, i] = measurement.psi_dot[i]
            effort[k, i] = state.torque[i]
            command[k, i] = cycle.torque[i]
            sliding_variable[k, i] = cycle.sliding_variable[i]
            coupled_error[k, i] = cycle.coupled_error[i]
        fault[k] = cycle.state.fault
        acted[k] = cycle.acted
        cycle_state = cycle.state
        memory = cycle.memory
        state = step(plant, robot, friction, disturbance, state, cycle.torque, period)
    return ClosedLoopRun(
        pose,
        theta,
        theta_dot,
        psi,
        psi_dot,
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
