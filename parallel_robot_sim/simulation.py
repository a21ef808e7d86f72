"""The closed loop without ROS: trajectory, controller and plant of a configuration."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import nullcontext
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base import config
from parallel_robot_base.errors import InputError, RunError
from parallel_robot_base.kernel import in_memory
from parallel_robot_base.loop import LoopParameters
from parallel_robot_base.loop import validate as validate_loop
from parallel_robot_control.controller import first_guess
from parallel_robot_control.cycle import CycleState, initial_state, run_cycle
from parallel_robot_control.laws import LAWS, PreparedLaw, available, prepare
from parallel_robot_control.safety import Limits, SafetyParameters, limits_of
from parallel_robot_model.planar_3rrr.parameters import RobotParameters, validate
from parallel_robot_sim.closed_loop import ClosedLoopRun, compiled_loop, run
from parallel_robot_sim.simulator import Simulator
from trajectory_gen import preflight
from trajectory_gen.trajectory import SHAPES, Reference, Trajectory, TrajectoryParameters

Array = NDArray[np.float64]

MOST_SAMPLES = 5_000_000  # of a simulation, which keeps all of them in memory


class Parts(NamedTuple):
    """The parts of a loop, checked.

    Attributes:
        loop: Period, joints and the like.
        law: The law, compiled.
        nominal: Robot as the controller believes it to be.
        limits: What the controller never exceeds.
        cycle: State of the controller before the first cycle.
        trajectory: Desired motion.
        simulator: True robot at its initial pose.
    """

    loop: LoopParameters
    law: PreparedLaw
    nominal: RobotParameters
    limits: Limits
    cycle: CycleState
    trajectory: Trajectory
    simulator: Simulator

    def run(self, reference: Reference) -> ClosedLoopRun:
        """Run the loop over a reference, from the initial states."""
        simulator = self.simulator
        return run(
            self.law.update,
            self.law.gains,
            self.nominal,
            self.limits,
            reference,
            simulator.stepping,
            simulator.robot,
            simulator.friction,
            simulator.disturbance,
            simulator.state,
            self.cycle,
            self.law.memory,
            self.loop.period,
        )


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

    @property
    def fault(self) -> tuple[float, int] | None:
        """Time [s] and code of the fault that the controller fell into, if it did."""
        found = np.flatnonzero(self.run.fault)
        if not found.size:
            return None
        return float(found[0] * self.loop.period), int(self.run.fault[found[0]])


def assemble(values: Mapping[str, Any]) -> Parts:
    """Build and check all parts of the loop of a resolved configuration.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot do the motion.
    """
    loop = validate_loop(config.group(values, LoopParameters, ''))
    if loop.samples is None:
        raise InputError('duration must be positive: a run needs an end')
    for name, module in available(values).items():
        config.group(values, module.Gains, name)
    for name, shape in SHAPES.items():
        config.group(values, shape.Parameters, name)
    nominal = validate(config.group(values, RobotParameters, 'robot'))
    law = prepare(loop.law, values)
    simulator = Simulator(values)
    trajectory = Trajectory.of(values)
    preflight.check(
        trajectory, config.group(values, TrajectoryParameters, 'trajectory'), loop.period
    )
    limits = limits_of(config.group(values, SafetyParameters, 'safety'))
    cycle = initial_state(np.array(first_guess(values)))
    return Parts(loop, law, nominal, limits, cycle, trajectory, simulator)


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Run the closed loop of a resolved configuration for its ``duration``.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot do the motion.
        RunError: the robot left its workspace.
    """
    parts = assemble(values)
    loop = parts.loop
    samples = loop.samples or 0
    if samples > MOST_SAMPLES:
        raise InputError(
            f'duration must be at most {MOST_SAMPLES * loop.period:g} s in a simulation, '
            f'not {loop.duration:g}'
        )
    reference = parts.trajectory.sample(np.arange(samples + 1) * loop.period)
    with in_memory(compiled_loop, run_cycle) if parts.law.name not in LAWS else nullcontext():
        parts.run(parts.trajectory.sample(0.0))  # compiles the loop, or loads it
    begun = time.perf_counter()
    result = parts.run(reference)
    loop_time = time.perf_counter() - begun
    if result.steps <= samples:
        last = (result.steps - 1) * loop.period
        raise RunError(f'the robot was driven out of its workspace after t = {last:.3f} s')
    return Simulation(loop, parts.law, reference, result, loop_time)
