"""The simulated robot: integrated in its pose, so its loops stay closed to round-off for ever."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.errors import InputError
from parallel_robot_base.fields import Field
from parallel_robot_base.kernel import kernel
from parallel_robot_base.linear_algebra import inverse, multiply, multiply_transposed
from parallel_robot_model.planar_3rrr.dynamics import pose_dynamics
from parallel_robot_model.planar_3rrr.kinematics import inverse_kinematics, velocity_maps
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_sim.disturbance import DisturbanceParameters, disturbance_torque
from parallel_robot_sim.friction import FrictionParameters, friction_torque
from parallel_robot_sim.integrators import ode3, rk4

Array = NDArray[np.float64]


class PlantParameters(NamedTuple):
    """Start, integration and motors of the plant."""

    initial_pose: Annotated[
        tuple[float, float, float], Field('m, m, rad', 'x, y, phi at rest at the start')
    ]
    integrator: Annotated[Literal['ode3', 'rk4'], Field('', 'fixed-step integrator')]
    substeps: Annotated[int, Field('', 'integration steps in one period', 1, 1000)]
    torque_limit: Annotated[
        tuple[float, float, float], Field('N m', 'saturation of the motors', 0.0)
    ]
    command_timeout: Annotated[
        float, Field('s', 'time without a command until the safe action (wall time)', 1e-3)
    ]
    timeout_action: Annotated[
        Literal['zero', 'damp', 'hold'],
        Field('', 'what the motors do then, with the gains safety.damping and safety.stiffness'),
    ]
    steps: Annotated[int, Field('', 'samples that ~/step takes in lockstep', 1, 1_000_000)]
    publish_passive: Annotated[bool, Field('', 'passive joints in joint_states')]


class Stepping(NamedTuple):
    """What one step of the plant needs of its parameters, as numbers."""

    order: int
    substeps: int
    torque_limit: tuple[float, float, float]


def stepping(parameters: PlantParameters) -> Stepping:
    """Take the numbers out of the parameters."""
    order = {'ode3': 3, 'rk4': 4}[parameters.integrator]
    return Stepping(order, parameters.substeps, parameters.torque_limit)


class PlantState(NamedTuple):
    """State of the plant.

    Attributes:
        pose: (x, y, phi) [m, m, rad], shape (3,).
        rate: Its derivative [m/s, m/s, rad/s], shape (3,).
        torque: Motor torque of the step that ended here [N m], shape (3,).
        time: Since the start [s].
    """

    pose: Array
    rate: Array
    torque: Array
    time: float = 0.0


class Measurement(NamedTuple):
    """Joints of the plant at one state, each shape (3,).

    Attributes:
        theta: Actuated angles [rad].
        theta_dot: Actuated rates [rad/s].
        psi: Passive angles beta - theta [rad], in (-pi, pi].
        psi_dot: Passive rates [rad/s].
    """

    theta: Array
    theta_dot: Array
    psi: Array
    psi_dot: Array


def initial_state(parameters: PlantParameters, robot: RobotParameters) -> PlantState:
    """State at rest at the initial pose.

    Raises:
        InputError: a leg does not reach the initial pose.
    """
    pose = np.array(parameters.initial_pose)
    leg = inverse_kinematics(robot, pose).out_of_reach
    if leg >= 0:
        raise InputError(
            f'plant.initial_pose {list(parameters.initial_pose)} is out of reach of leg {leg + 1} '
            f'(a leg spans {abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m)'
        )
    return PlantState(pose, np.zeros(3), np.zeros(3), 0.0)


@kernel
def _derivative(
    y: Array,
    arguments: tuple[RobotParameters, FrictionParameters, DisturbanceParameters, Array],
) -> Array:
    """d/dt (pose, rate, time): M_x Xdd = H^T (tau - friction - delta) - Q_x Xdot."""
    robot, friction, disturbance, torque = arguments
    rate = y[3:6]
    legs = inverse_kinematics(robot, y[:3])
    M, Q, H, _ = pose_dynamics(robot, y[2], legs.theta, legs.beta, rate)
    drive = torque - friction_torque(friction, multiply(H, rate))
    drive -= disturbance_torque(disturbance, y[6])
    force = multiply_transposed(H, drive) - multiply(Q, rate)
    result = np.empty(7)
    result[:3] = rate
    result[3:6] = multiply(inverse(M), force)
    result[6] = 1.0
    return result


@kernel
def step(
    stepping: Stepping,
    robot: RobotParameters,
    friction: FrictionParameters,
    disturbance: DisturbanceParameters,
    state: PlantState,
    command: Array,
    period: float,
) -> PlantState:
    """Advance the plant by one period under a constant command.

    Args:
        stepping: Integrator, substeps, torque limit.
        robot: The true robot.
        friction: Friction of the actuated joints.
        disturbance: Disturbance of the actuated joints.
        state: State at the start of the period.
        command: Commanded torque [N m], shape (3,).
        period: [s].

    Returns:
        State at the end; not finite when the robot was driven out of its workspace.
    """
    torque = np.empty(3)
    for i in range(3):
        limit = stepping.torque_limit[i]
        torque[i] = min(max(command[i], -limit), limit)
    y: Array = np.empty(7)
    y[:3] = state.pose
    y[3:6] = state.rate
    y[6] = state.time
    h = period / stepping.substeps
    arguments = (robot, friction, disturbance, torque)
    for _ in range(stepping.substeps):
        if stepping.order == 3:
            y = ode3(_derivative, y, h, arguments)
        else:
            y = rk4(_derivative, y, h, arguments)
    return PlantState(y[:3].copy(), y[3:6].copy(), torque, state.time + period)


@kernel
def measure(robot: RobotParameters, state: PlantState) -> Measurement:
    """Joint angles and rates of a state."""
    legs = inverse_kinematics(robot, state.pose)
    maps = velocity_maps(robot, state.pose[2], legs.theta, legs.beta, state.rate)
    theta_dot = multiply(maps.H, state.rate)
    psi = np.arctan2(np.sin(legs.beta - legs.theta), np.cos(legs.beta - legs.theta))
    return Measurement(legs.theta, theta_dot, psi, multiply(maps.K, state.rate) - theta_dot)
