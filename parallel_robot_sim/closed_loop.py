"""The closed loop without ROS: trajectory, law and plant in one compiled loop."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.controller import first_guess
from parallel_robot_control.cycle import CYCLE_TEXT, run_cycle
from parallel_robot_control.laws import LAWS, PreparedLaw, prepare
from parallel_robot_interface import config
from parallel_robot_interface.errors import InputError, RunError
from parallel_robot_interface.loop import LoopParameters
from parallel_robot_interface.loop import validate as validate_loop
from parallel_robot_model.kernel import kernel
from parallel_robot_model.kinematics import FOUND
from parallel_robot_model.parameters import RobotParameters, validate
from parallel_robot_sim.disturbance import DisturbanceParameters
from parallel_robot_sim.friction import FrictionParameters
from parallel_robot_sim.plant import PlantState, Stepping, measure, step
from parallel_robot_sim.simulator import Simulator
from trajectory_gen import preflight
from trajectory_gen.trajectory import SHAPES, Reference, Trajectory, TrajectoryParameters

Array = NDArray[np.float64]

MOST_SAMPLES = 5_000_000  # of a simulation, which keeps all of them in memory


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
        integral: int De dt before the state [rad s].
        status: FOUND, or why the controller could not answer the last state.
        steps: Number of rows that were computed; fewer than N when `status` is not FOUND or the
            plant left its workspace.
    """

    pose: Array
    theta: Array
    theta_dot: Array
    psi: Array
    psi_dot: Array
    effort: Array
    command: Array
    sliding_variable: Array
    integral: Array
    status: int
    steps: int


@kernel
def run(
    update: Any,
    gains: Any,
    memory: Any,
    nominal: RobotParameters,
    guess: Array,
    reference: Reference,
    plant: Stepping,
    robot: RobotParameters,
    friction: FrictionParameters,
    disturbance: DisturbanceParameters,
    state: PlantState,
    period: float,
) -> ClosedLoopRun:
    """Run the loop over all samples of a reference.

    Args:
        update: The law, as FirstClass.
        gains: Its gains.
        memory: Its initial memory.
        nominal: Robot as the controller believes it to be.
        guess: First guess of the controller's forward kinematics, shape (3,).
        reference: Desired motion, one sample a period.
        plant: Integration and motors.
        robot: True robot.
        friction: Friction of the true robot.
        disturbance: Disturbance of the true robot.
        state: State 0.
        period: [s].

    Returns:
        The run.
    """
    count = len(reference.position)
    pose = np.empty((count, 3))
    theta = np.empty((count, 3))
    theta_dot = np.empty((count, 3))
    psi = np.empty((count, 3))
    psi_dot = np.empty((count, 3))
    effort = np.empty((count, 3))
    command = np.empty((count, 3))
    sliding_variable = np.empty((count, 3))
    integrals = np.empty((count, 3))
    integral: Array = np.zeros(3)
    status = FOUND
    steps = count
    for k in range(count):
        measurement = measure(robot, state)
        if not np.all(np.isfinite(measurement.theta_dot)):
            steps = k
            break
        desired = JointReference(
            reference.position[k], reference.velocity[k], reference.acceleration[k]
        )
        feedback = Feedback(measurement.theta, measurement.theta_dot)
        integrals[k] = integral
        cycle = run_cycle(
            update, gains, nominal, desired, feedback, guess, integral, memory, period
        )
        pose[k] = state.pose
        theta[k] = measurement.theta
        theta_dot[k] = measurement.theta_dot
        psi[k] = measurement.psi
        psi_dot[k] = measurement.psi_dot
        effort[k] = state.torque
        command[k] = cycle.torque
        sliding_variable[k] = cycle.sliding_variable
        guess = cycle.pose
        integral = cycle.integral
        memory = cycle.memory
        if cycle.status != FOUND:
            status = cycle.status
            steps = k + 1
            break
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
        integrals,
        status,
        steps,
    )


class Assembly(NamedTuple):
    """The parts of a loop, checked.

    Attributes:
        loop: Period, joints and the like.
        law: The law, compiled.
        nominal: Robot as the controller believes it to be.
        guess: First guess of the controller's forward kinematics, shape (3,).
        trajectory: Desired motion.
        simulator: True robot at its initial pose.
    """

    loop: LoopParameters
    law: PreparedLaw
    nominal: RobotParameters
    guess: Array
    trajectory: Trajectory
    simulator: Simulator


class Simulation(NamedTuple):
    """A run with what it was made of.

    Attributes:
        loop: Period, joints and the like.
        law: The law that ran.
        reference: Desired motion, one row a state.
        run: What happened.
        loop_time: Time spent in the loop [s].
    """

    loop: LoopParameters
    law: PreparedLaw
    reference: Reference
    run: ClosedLoopRun
    loop_time: float


def assemble(values: Mapping[str, Any]) -> Assembly:
    """Build and check all parts of the loop of a resolved configuration.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot do the motion.
    """
    loop = validate_loop(config.group(values, LoopParameters, ''))
    if loop.samples is None:
        raise InputError('duration must be positive: a run needs an end')
    for name, module in LAWS.items():
        config.group(values, module.Gains, name)
    for name, shape in SHAPES.items():
        config.group(values, shape.Parameters, name)
    nominal = validate(config.group(values, RobotParameters, 'robot'))
    law = prepare(loop.law, values)
    simulator = Simulator(values)
    trajectory = Trajectory.of(values)
    limits = config.group(values, TrajectoryParameters, 'trajectory')
    preflight.check(trajectory, limits, loop.period)
    return Assembly(loop, law, nominal, np.array(first_guess(values)), trajectory, simulator)


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Run the closed loop of a resolved configuration for its ``duration``.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot do the motion.
        RunError: the robot left its workspace, or the controller had no answer.
    """
    loop, law, nominal, guess, trajectory, simulator = assemble(values)
    samples = loop.samples or 0
    if samples > MOST_SAMPLES:
        raise InputError(
            f'duration must be at most {MOST_SAMPLES * loop.period:g} s in a simulation, '
            f'not {loop.duration:g}'
        )
    reference = trajectory.sample(np.arange(samples + 1) * loop.period)

    def run_over(desired: Reference) -> ClosedLoopRun:
        return run(
            law.update,
            law.gains,
            law.memory,
            nominal,
            guess,
            desired,
            simulator.stepping,
            simulator.robot,
            simulator.friction,
            simulator.disturbance,
            simulator.state,
            loop.period,
        )

    run_over(trajectory.sample(0.0))  # compiles the loop, or loads it
    begun = time.perf_counter()
    result = run_over(reference)
    loop_time = time.perf_counter() - begun
    last = (result.steps - 1) * loop.period
    if result.status != FOUND:
        raise RunError(f'stopped at t = {last:.3f} s: {CYCLE_TEXT[result.status]}')
    if result.steps <= samples:
        raise RunError(f'the robot was driven out of its workspace after t = {last:.3f} s')
    return Simulation(loop, law, reference, result, loop_time)
