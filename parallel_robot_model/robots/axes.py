"""Independent positioning axes that are to move in step.

Each of the n axes is a motor that turns a load. There is no gravity and no coupling between the
axes, so any synchronisation comes from the control law. In the joint positions q, which are also
the pose and the coordinates of the plant:

    diag(I_1 ... I_n) qdd = tau,    M = diag(I_1 ... I_n),  Q = 0,  gravity = 0

Source:
    Koren (1980), Cross-Coupled Biaxial Computer Control for Manufacturing Systems, Journal of
    Dynamic Systems, Measurement, and Control 102(4): axes as the plant of synchronised motion.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import every, kernel, select, vector
from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.robots import axes_linear_model as linear_model  # noqa: F401
from parallel_robot_model.robots.contract import (
    FOUND,
    REACHED,
    Coordinate,
    Estimate,
    Fault,
    Infeasible,
    JointMotion,
    Location,
    Measurement,
    Model,
    PoseMotion,
    first_sample,
    no_model,
)
from parallel_robot_model.robots.joint_load import JointLoad, net_torque

PARTS = ('axis', 'machine')
PLANAR = False
END_OF_TRAVEL = 1
FAULTS = {END_OF_TRAVEL: Fault('end_of_travel', 'an axis is close to an end of its travel')}
NO_POSE = ()  # joints have one pose


class Parameters(NamedTuple):
    """Inertia and travel of each axis."""

    inertia: Annotated[PerJoint, Field('kg m^2', 'inertia of motor and load per axis')]
    lower: Annotated[PerJoint, Field('rad', 'lower end of travel per axis')]
    upper: Annotated[PerJoint, Field('rad', 'upper end of travel per axis')]


class SafetyMargins(NamedTuple):
    """Limits beyond which the controller enters a fault."""

    min_travel: Annotated[float, Field('rad', 'distance to an end of travel that is a fault', 0.0)]


class MotionLimits(NamedTuple):
    """Limits of a reference motion."""

    min_travel: Annotated[
        float, Field('rad', 'smallest distance to an end of travel allowed', 0.0)
    ]


def validate(robot: Parameters, name: str = 'robot') -> Parameters:
    """Return `robot` if it can be built.

    Raises:
        RobotError: there is no axis; the number of ends of travel is not that of inertias; an
            inertia is not positive; a lower end of travel is not below the upper one.
    """
    count = len(robot.inertia)
    if not count:
        raise RobotError(f'{name}.inertia must hold at least one number', f'{name}.inertia')
    for key in ('lower', 'upper'):
        ends = len(getattr(robot, key))
        if ends != count:
            what = f'{name}.{key}'
            raise RobotError(f'{what} must hold {count} numbers like inertia, not {ends}', what)
    for axis, inertia in enumerate(robot.inertia, start=1):
        if not inertia > 0.0:
            what = f'{name}.inertia'
            raise RobotError(f'{what} must be positive, not {inertia:g} (axis {axis})', what)
    for axis, (lower, upper) in enumerate(zip(robot.lower, robot.upper, strict=True), start=1):
        if not lower < upper:
            raise RobotError(
                f'{name}.lower must be below {name}.upper, not {lower:g} and {upper:g} rad '
                f'(axis {axis})',
                f'{name}.lower',
            )
    return robot


def joints(robot: Parameters) -> int:
    """One for each axis."""
    return len(robot.inertia)


def coordinates(robot: Parameters) -> tuple[Coordinate, ...]:
    """Positions of the axes: q1, q2, ... ."""
    return tuple(Coordinate(f'q{axis}', 'rad') for axis in range(1, joints(robot) + 1))


def start(robot: Parameters, pose: Array) -> Array:
    """The pose itself, shape (n,), if it lies within the travel of all axes.

    Raises:
        InputError: it does not.
    """
    for i in range(joints(robot)):
        if not robot.lower[i] <= pose[i] <= robot.upper[i]:
            raise InputError(
                f'plant.initial_pose {pose.tolist()} is out of reach of axis {i + 1} '
                f'(it travels from {robot.lower[i]:g} to {robot.upper[i]:g} rad)',
                'plant.initial_pose',
            )
    return pose


@kernel
def joint_motion(robot: Parameters, motion: PoseMotion) -> JointMotion:
    """The motion of the pose itself, also beyond the travel, which :func:`infeasible` checks."""
    none = vector(())  # no passive joints
    return JointMotion(motion.pose, motion.rate, motion.acceleration, none, REACHED)


@kernel
def locate(robot: Parameters, position: Array, guess: Array) -> Location:
    """The joint positions themselves [rad], shape (n,); the guess does not matter."""
    return Location(position, FOUND)


@kernel
def estimate(
    robot: Parameters, margins: SafetyMargins, position: Array, velocity: Array, guess: Array
) -> Estimate:
    """Pose, margin and model at a joint state."""
    # Travel left: q_i - lower_i and upper_i - q_i >= min_travel, which NaN does not meet.
    below, above = position - vector(robot.lower), vector(robot.upper) - position
    left = (below >= margins.min_travel) & (above >= margins.min_travel)
    fault = select(every(left), FOUND, END_OF_TRAVEL)
    # M = diag(I_1 ... I_n); nothing couples the axes and nothing pulls at them.
    M = np.diag(vector(robot.inertia))
    model = Model(M, np.zeros_like(M), np.zeros_like(position))
    return Estimate(fault, position, select(fault == FOUND, model, no_model(model)))


@kernel
def acceleration(
    robot: Parameters, load: JointLoad, position: Array, rate: Array, torque: Array, time: float
) -> Array:
    """Second derivative of the joint positions: qdd_i = (tau_i - friction_i - delta_i) / I_i."""
    return net_torque(load, torque, rate, time) / vector(robot.inertia)


@kernel
def measure(robot: Parameters, position: Array, rate: Array) -> Measurement:
    """The plant's coordinates are the joints and the pose, each shape (n,)."""
    none = vector(())
    return Measurement(position, rate, none, none, position)


def infeasible(robot: Parameters, limits: MotionLimits, reference: Any) -> list[Infeasible]:
    """First sample of a motion that brings an axis too close to an end of its travel."""
    position = reference.position
    left = np.minimum(position - np.array(robot.lower), np.array(robot.upper) - position)
    failure = first_sample(
        left < limits.min_travel,
        left,
        'end of travel, {} rad left is below trajectory.min_travel, {} rad',
        limits.min_travel,
    )
    return [] if failure is None else [failure]


def segments(robot: Parameters, pose: Array, position: Array) -> dict[str, Array]:
    """Nothing: independent axes have no picture."""
    return {}
