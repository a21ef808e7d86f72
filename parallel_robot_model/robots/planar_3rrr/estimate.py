"""What the controller knows of the robot from its joints: pose, margins, model."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, select
from parallel_robot_model.robots.contract import FOUND, Estimate, Location, no_model
from parallel_robot_model.robots.planar_3rrr.dynamics import (
    actuated_dynamics,
    measures,
    type_2_measure,
)
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import (
    NOT_CONVERGED,
    forward_kinematics,
)
from parallel_robot_model.robots.planar_3rrr.geometry import Constants, posture_at
from parallel_robot_model.robots.planar_3rrr.margins import TYPE_1, TYPE_2, SafetyMargins

FAST = 1.5  # states until the singularity, below which the assembly mode is not trusted


@kernel
def locate(robot: Constants, position: Array, guess: Array) -> Location:
    """Pose at joint angles [rad], shape (3,), on the assembly mode of the guess, shape (3,)."""
    assembly = forward_kinematics(robot, position, guess)
    return Location(assembly.pose, assembly.status)


@kernel
def estimate(
    robot: Constants,
    margins: SafetyMargins,
    position: Array,
    velocity: Array,
    guess: Array,
) -> Estimate:
    """Pose, margins and model at a joint state.

    Args:
        robot: The robot.
        margins: Limits beyond which there is a fault.
        position: Actuated angles [rad], shape (3,).
        velocity: Their rates [rad/s], shape (3,).
        guess: A pose near it, e.g. the previous one [m, m, rad], shape (3,).
    """
    pose, posture, status = forward_kinematics(robot, position, guess)
    margin = measures(robot, posture)
    near_type_2 = select(margin.type_2 < margins.min_determinant, TYPE_2, FOUND)
    near = select(margin.type_1 < margins.min_sin_psi, TYPE_1, near_type_2)
    fault = select(status == FOUND, near, status)
    if fault == TYPE_2:  # at this rate it may be beyond the singularity before the next state
        before = abs(type_2_measure(robot, posture_at(robot, guess)))
        fault = select(margin.type_2 < FAST * (before - margin.type_2), NOT_CONVERGED, fault)
    model = actuated_dynamics(robot, posture, velocity)
    return Estimate(fault, pose, select(fault == FOUND, model, no_model(model)))
