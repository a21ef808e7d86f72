"""One step of the simulated robot: motors, friction and disturbance, integration."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, inline_ir, internal, kernel
from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_sim.drive_step import flexed, record_braked, rotors
from parallel_robot_sim.hazards import (
    CommandState,
    braked,
    commanded,
    hold_or_time_out,
    limited,
    told,
)
from parallel_robot_sim.noise_and_delay import sample_at
from parallel_robot_sim.sensors_actuators import (
    cogging,
    driven,
    effort_at_stamp,
    held_disturbance,
    record_sensed,
    sensed,
)

# Fixed-step integrators of second-order motion: each takes the acceleration as a function.


@inline_ir
def ode3(
    acceleration: Any, q: Array, v: Array, t: float, h: float, arguments: Any
) -> tuple[Array, Array]:
    """One step of Bogacki-Shampine 3(2) without its error estimate, as Simulink's ode3.

    Args:
        acceleration: Second derivative of q, called with q, v, t and the arguments.
        q: Coordinates at the start of the step, shape (c,).
        v: Their derivative, shape (c,).
        t: Time at the start of the step [s].
        h: Length of the step [s].
        arguments: Further arguments of the acceleration.

    Returns:
        Both at the end of the step.

    Source:
        Bogacki, Shampine (1989), Appl. Math. Lett. 2(4).
    """
    a1 = acceleration(q, v, t, arguments)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(q + 0.5 * h * v, v2, t + 0.5 * h, arguments)
    v3 = v + 0.75 * h * a2
    a3 = acceleration(q + 0.75 * h * v2, v3, t + 0.75 * h, arguments)
    return (
        q + h / 9.0 * (2.0 * v + 3.0 * v2 + 4.0 * v3),
        v + h / 9.0 * (2.0 * a1 + 3.0 * a2 + 4.0 * a3),
    )


@inline_ir
def rk4(
    acceleration: Any, q: Array, v: Array, t: float, h: float, arguments: Any
) -> tuple[Array, Array]:
    """One step of the classical Runge-Kutta method of order 4; arguments as of :func:`ode3`."""
    a1 = acceleration(q, v, t, arguments)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(q + 0.5 * h * v, v2, t + 0.5 * h, arguments)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(q + 0.5 * h * v2, v3, t + 0.5 * h, arguments)
    v4 = v + h * a3
    a4 = acceleration(q + h * v3, v4, t + h, arguments)
    return (
        q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
    )


MUJOCO = 'mujoco'  # the engine that nodes alone can use
ODE3 = 0  # place of its word in PlantParameters.integrator


class PlantParameters(NamedTuple):
    """Start, integration and motors of the plant."""

    engine: Annotated[
        Literal['analytic', 'mujoco'],
        Field('', 'what moves the robot: its equations, or MuJoCo, which nodes alone can use'),
    ]

    initial_pose: Annotated[
        tuple[float, ...], Field('', 'pose at rest at the start, in the units of the robot')
    ]
    integrator: Annotated[Literal['ode3', 'rk4'], Field('', 'fixed-step integrator')]
    substeps: Annotated[int, Field('', 'integration steps in one period', 1, 1000)]
    torque_limit: Annotated[PerJoint, Field('N m', 'saturation of the motors', 0.0)]
    torque_forward: Annotated[
        PerJoint, Field('', 'share of torque_limit that the motors have forwards', 0.0, 1.0)
    ]
    torque_backward: Annotated[
        PerJoint, Field('', 'share that they have backwards; 0: they only push', 0.0, 1.0)
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


def unlimited(parameters: PlantParameters) -> PlantParameters:
    """The same with motors without torque limits."""
    n = len(parameters.torque_limit)
    whole = PerJoint((1.0,) * n)
    return parameters._replace(
        torque_limit=PerJoint((math.inf,) * n), torque_forward=whole, torque_backward=whole
    )


class PlantSetup(NamedTuple):
    """The constant parts of the plant; parameters as :func:`as_constants`."""

    acceleration: Any  # acceleration of the robot module, as FunctionValue
    measure: Any  # measure of the robot module, as FunctionValue
    parameters: Any  # PlantParameters, boxed
    robot: Any  # constants of the true robot, boxed
    load: Any  # JointLoad, boxed
    imperfections: Any  # Imperfections, boxed
    safety: Any  # SafetyParameters, boxed; its action is that without commands
    timeout_samples: int  # samples without a command from which on the motors take it
    hazards: Any  # Hazards, boxed


class PlantState(NamedTuple):
    """State of the plant."""

    coordinates: Array  # coordinates that are integrated, e.g. the pose, shape (c,)
    rate: Array  # their derivative, shape (c,)
    torque: Array  # motor torque of the step that ended here [N m], shape (n,)
    time: float = 0.0  # time since the start [s]


class Seen(NamedTuple):
    """A sample of the plant."""

    true: Measurement  # joints and pose as they are
    position: Array  # measured angles [rad], shape (n,)
    velocity: Array  # their rates [rad/s], shape (n,)
    effort: Array  # measured torque [N m], shape (n,)


@internal
def observe(
    setup: PlantSetup, state: PlantState, sample: int, period: float, is_published: bool
) -> Seen:
    """The state of a sample as it is, and as it is measured.

    Args:
        setup: The plant.
        state: Its state.
        sample: Index of the sample.
        period: Of the samples [s].
        is_published: Whether hazards leave a message of it.
    """
    true = setup.measure(setup.robot, state.coordinates, state.rate)
    position, velocity, effort = true.position, true.velocity, state.torque
    if setup.imperfections.on:
        position, velocity = sensed(setup, true, state.time, period)
        effort = effort_at_stamp(setup, effort, state.time, period)
    if setup.hazards.on:
        reported = told(setup.hazards, sample, position, velocity, effort)
        if is_published:
            position, velocity, effort = reported
    return Seen(true, position, velocity, effort)


@internal
def demanded(
    setup: PlantSetup,
    state: PlantState,
    waiting: CommandState,
    command: Array,
    arrived: bool,
    sample: int,
) -> tuple[Array, CommandState]:
    """Torque demanded of the motors over the period after a sample [N m], shape (n,).

    Args:
        setup: The plant.
        state: Its state.
        waiting: What the motors know of the commands before it.
        command: The newest one [N m], shape (n,).
        arrived: Whether it is one for this period.
        sample: Index of the sample.
    """
    if arrived and not setup.hazards.on:
        return command, CommandState(0, waiting.held, waiting.command)
    joints = setup.measure(setup.robot, state.coordinates, state.rate)
    if setup.hazards.on:
        arrived, command = commanded(setup.hazards, sample, arrived, command, waiting)
    return hold_or_time_out(setup, waiting, arrived, command, joints.position, joints.velocity)


@kernel
def _acceleration(
    coordinates: Array, rate: Array, time: float, arguments: tuple[PlantSetup, Array]
) -> Array:
    """Second derivative of the coordinates under motor torques."""
    setup, torque = arguments
    return setup.acceleration(setup.robot, setup.load, coordinates, rate, torque, time)


@kernel
def torques(
    setup: PlantSetup, state: PlantState, command: Array, period: float
) -> tuple[Array, Array]:
    """Torques over one period under a constant command, see :func:`step` [N m].

    Returns:
        That of the motors, and less the disturbances that are constant over a period; each
        shape (n,).
    """
    motors = setup.parameters
    limit = motors.torque_limit
    if setup.hazards.on:
        limit = limited(setup.hazards, sample_at(state.time, period), limit)
    greatest, least = motors.torque_forward * limit, -motors.torque_backward * limit
    torque = clip(command, least, greatest)
    applied = torque
    if setup.imperfections.on:
        joints = setup.measure(setup.robot, state.coordinates, state.rate)
        record_sensed(setup, joints, state.torque, state.time, period)
        torque = driven(setup, command, least, greatest, state.time, period)
        applied = torque - held_disturbance(setup, joints.position, state.time, period)
    return torque, applied


@kernel
def step(setup: PlantSetup, state: PlantState, command: Array, period: float) -> PlantState:
    """Advance the plant by one period under a constant command.

    Args:
        setup: The robot, its load, its integrator.
        state: State at the start of the period.
        command: Commanded torque [N m], shape (n,).
        period: Length of the period [s].

    Returns:
        State at the end; not finite if the robot was driven out of its workspace.
    """
    substeps, integrator = setup.parameters.substeps, setup.parameters.integrator
    torque, applied = torques(setup, state, command, period)
    q, v, t = state.coordinates, state.rate, state.time
    drive = setup.imperfections.on and setup.imperfections.drive.on
    if setup.hazards.on and braked(setup.hazards, sample_at(t, period)):
        if drive:
            record_braked(setup, setup.measure(setup.robot, q, v), t, period)
        return PlantState(q, np.zeros_like(v), torque, t + period)
    if drive:
        joints = setup.measure(setup.robot, q, v)
        angle, _ = rotors(setup, joints, sample_at(t, period))
        load = torque - applied - cogging(setup, joints.position)
        q, v = flexed(setup, q, v, torque - cogging(setup, angle), load, t, period)
        return PlantState(q, v, torque, t + period)
    h = period / substeps
    arguments = (setup, applied)
    for _ in range(substeps):
        if integrator == ODE3:
            q, v = ode3(_acceleration, q, v, t, h, arguments)
        else:
            q, v = rk4(_acceleration, q, v, t, h, arguments)
        t += h
    return PlantState(q, v, torque, state.time + period)
