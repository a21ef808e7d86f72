"""What the controller knows of the robot from its joints: pose, margins, model."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, kernel, select, vector
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import (
    FOUND,
    REACHED,
    Estimate,
    Fault,
    Infeasible,
    JointMotion,
    Location,
    Margin,
    Measurement,
    PoseMotion,
    first_sample,
    no_model,
)
from parallel_robot_model.robots.planar_3rrr.dynamics import (
    actuated_dynamics,
    centripetal,
    condition_numbers,
    determinants,
    measures,
    rates_of,
    type_2_measure,
    velocity_maps,
)
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import (
    GUESS_OUT_OF_REACH,
    NOT_CONVERGED,
    STATUS_TEXT,
    WRONG_WORKING_MODE,
    forward_kinematics,
)
from parallel_robot_model.robots.planar_3rrr.kinematics import (
    Constants,
    RobotParameters,
    constants,
    inverse_kinematics,
    out_of_reach,
    posture_at,
    theta_of,
)

# How close the robot may come to its singularities, and its faults.

TYPE_1 = 4
TYPE_2 = 5
FAULTS = {
    GUESS_OUT_OF_REACH: Fault('guess_out_of_reach', STATUS_TEXT[GUESS_OUT_OF_REACH]),
    NOT_CONVERGED: Fault('not_converged', STATUS_TEXT[NOT_CONVERGED]),
    WRONG_WORKING_MODE: Fault('wrong_working_mode', STATUS_TEXT[WRONG_WORKING_MODE]),
    TYPE_1: Fault(
        'type_1_singularity',
        'a leg is close to being stretched or folded (type 1 singularity)',
    ),
    TYPE_2: Fault('type_2_singularity', 'the platform is close to yielding (type 2 singularity)'),
}
NO_POSE = (GUESS_OUT_OF_REACH, NOT_CONVERGED, WRONG_WORKING_MODE)


class SafetyMargins(NamedTuple):
    """Limits beyond which the controller enters a fault."""

    min_sin_psi: Annotated[
        float, Field('', '|sin psi| that is a fault (type 1 singularity)', 0.0, 1.0)
    ]
    min_determinant: Annotated[
        float, Field('', '|det Jx| / l3 that is a fault (type 2 singularity)', 0.0)
    ]


class MotionLimits(NamedTuple):
    """Limits of a reference motion."""

    min_sin_psi: Annotated[float, Field('', 'smallest |sin psi| allowed (type 1)', 0.0, 1.0)]
    max_condition: Annotated[float, Field('', 'largest cond(Jx) allowed (type 2)', 1.0)]


def infeasible(robot: RobotParameters, limits: MotionLimits, reference: Any) -> list[Infeasible]:
    """First samples of a motion that are out of reach or too near to a singularity.

    Args:
        robot: The robot.
        limits: Limits of the motion.
        reference: The motion, see trajectory_gen.trajectory.Reference.
    """
    unreached = np.flatnonzero(reference.out_of_reach >= 0)
    reached = slice(0, int(unreached[0]) if unreached.size else None)
    beta = reference.passive[reached]
    sines = _sines(reference.position[reached], beta)
    conditions = condition_numbers(robot, reference.pose[reached, 2], beta)
    failures = [
        first_sample(
            sines < limits.min_sin_psi,
            sines,
            'type 1 singularity, |sin psi| = {} is below trajectory.min_sin_psi, {}',
            limits.min_sin_psi,
        ),
        first_sample(
            conditions > limits.max_condition,
            conditions,
            'type 2 singularity, cond(Jx) = {} is above trajectory.max_condition, {}',
            limits.max_condition,
        ),
    ]
    if unreached.size:
        k = int(unreached[0])
        reach = f'{abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m'
        leg = int(reference.out_of_reach[k]) + 1
        failures.append(Infeasible(k, leg, f'out of reach (a leg spans {reach})'))
    return [failure for failure in failures if failure is not None]


def margins(robot: RobotParameters, reference: Any) -> tuple[Margin, Margin]:
    """Distances from singularities of type 1 and 2 along a motion, each shape (N,)."""
    beta = reference.passive
    sines = _sines(reference.position, beta).min(axis=1)
    of_platform = determinants(robot, reference.pose[:, 2], beta)
    return (
        Margin('min_sin_psi', 'smallest |sin ψ| of the legs (type 1)', sines),
        Margin('min_determinant', '|det Jx| / l3 (type 2)', of_platform),
    )


def _sines(theta: Array, beta: Array) -> Array:
    """|sin psi| of the legs."""
    return np.abs(np.sin(beta - theta))


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


# Motion of the joints for a motion of the platform.


@kernel
def joint_motion(robot: Constants, motion: PoseMotion) -> JointMotion:
    """Actuated angles with two derivatives: thetadd = H Xdd + H_dot Xdot; `passive` is beta."""
    posture = posture_at(robot, motion.pose)
    maps = velocity_maps(robot, posture)
    rates = rates_of(maps, motion.rate)
    theta, _ = centripetal(robot, posture, rates)
    return JointMotion(
        theta_of(robot, posture, motion.pose),
        rates.theta,
        maps.H @ motion.acceleration + theta,
        np.arctan2(posture.sb, posture.cb),
        out_of_reach(posture),
    )


@kernel
def measure(robot: Constants, pose: Array, rate: Array) -> Measurement:
    """Joints at a pose and its rate, each shape (3,); passive angles in (-pi, pi]."""
    posture = posture_at(robot, pose)
    rates = rates_of(velocity_maps(robot, posture), rate)
    return Measurement(
        theta_of(robot, posture, pose),
        rates.theta,
        np.arctan2(posture.sin_psi, posture.cos_psi),
        rates.beta - rates.theta,
        pose,
    )


def start(robot: RobotParameters, pose: Array) -> Array:
    """The pose itself, shape (3,), if all legs reach it.

    Raises:
        InputError: a leg does not reach it.
    """
    boxed: Any = Boxed(constants(robot))  # as the other kernels take them
    leg = inverse_kinematics(boxed, vector(pose)).out_of_reach
    if leg != REACHED:
        raise InputError(
            f'plant.initial_pose {pose.tolist()} is out of reach of leg {leg + 1} '
            f'(a leg spans {abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m)',
            'plant.initial_pose',
        )
    return pose
