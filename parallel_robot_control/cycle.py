"""One control cycle: forward kinematics, model, law; the same kernel with and without ROS."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.coupling import coupling
from parallel_robot_model.dynamics import actuated_dynamics
from parallel_robot_model.kernel import kernel
from parallel_robot_model.kinematics import FOUND, STATUS_TEXT, forward_kinematics
from parallel_robot_model.parameters import RobotParameters

Array = NDArray[np.float64]

# Outcomes of a cycle beside those of the forward kinematics.
TORQUE_NOT_FINITE = 10
CYCLE_TEXT = {**STATUS_TEXT, TORQUE_NOT_FINITE: 'the law gave a torque that is not finite'}


class Cycle(NamedTuple):
    """Result of one control cycle.

    Attributes:
        torque: [N m], shape (n,); zero unless `status` is FOUND.
        sliding_variable: In the law's unit, shape (n,).
        pose: Pose by forward kinematics, shape (3,); the guess of the next cycle.
        integral: int De dt [rad s], shape (n,), for the cross-coupling error that is published.
        memory: Memory of the law; unchanged unless `status` is FOUND.
        status: FOUND or a key of CYCLE_TEXT.
    """

    torque: Array
    sliding_variable: Array
    pose: Array
    integral: Array
    memory: Any
    status: int


@kernel
def run_cycle(
    update: Any,
    gains: Any,
    robot: RobotParameters,
    reference: JointReference,
    feedback: Feedback,
    pose: Array,
    integral: Array,
    memory: Any,
    dt: float,
) -> Cycle:
    """Compute the torque for one state.

    Args:
        update: The law, as FirstClass.
        gains: Gains of the law.
        robot: Nominal robot.
        reference: Desired joint motion at the state's stamp.
        feedback: The state.
        pose: Guess of the forward kinematics, shape (3,).
        integral: int De dt up to this state [rad s], shape (3,).
        memory: Memory of the law.
        dt: Time since the state before [s].
    """
    idle = np.zeros(len(feedback.position))
    assembly = forward_kinematics(robot, feedback.position, pose)
    if assembly.status != FOUND:
        return Cycle(idle, idle, pose, integral, memory, assembly.status)
    model = actuated_dynamics(
        robot, assembly.pose[2], feedback.position, assembly.beta, feedback.velocity
    )
    output = update(gains, model, reference, feedback, memory, dt)
    if not np.all(np.isfinite(output.torque)):
        return Cycle(idle, idle, assembly.pose, integral, memory, TORQUE_NOT_FINITE)
    advanced = integral + dt * coupling(reference.position - feedback.position)
    return Cycle(
        output.torque, output.sliding_variable, assembly.pose, advanced, output.memory, FOUND
    )
