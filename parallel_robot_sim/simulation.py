"""A run of the closed loop without ROS, from its configuration."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control import faults
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import at_measurement
from parallel_robot_control.delay_identification import phases, result
from parallel_robot_model.common.errors import DRIVEN_OUT, InputError, RunError
from parallel_robot_model.common.printable import apart
from parallel_robot_model.configuration.placed import locating
from parallel_robot_model.robots.contract import Fault
from parallel_robot_sim.assembly import Experiment, assemble
from parallel_robot_sim.closed_loop import ClosedLoopRun, head, run
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.course import Course, course_of
from parallel_robot_sim.plant import MUJOCO
from trajectory_gen.trajectory import Reference

MAX_SAMPLES = 5_000_000  # samples of a simulation, which keeps all of them in memory
ENDLESS = 'duration must be positive: a run needs an end'
NODES_ALONE = (
    'plant.engine must be analytic in a compiled loop, not mujoco: that is for the nodes, '
    'parallel_robot run --time-mode lockstep'
)


class Simulation(NamedTuple):
    """A run with its experiment.

    Attributes:
        configuration: Its configuration.
        experiment: The experiment that was run.
        reference: Desired motion, one row per state.
        run: Record of the run.
        loop_time: Time spent in the loop [s].
    """

    configuration: Configuration
    experiment: Experiment
    reference: Reference
    run: ClosedLoopRun
    loop_time: float

    @property
    def age(self) -> float:
        """Age of the states that their stamps tell [s]."""
        age: float = self.experiment.plant.setup.imperfections.age
        return age

    @property
    def course(self) -> Course:
        """What hazards made of the course of the run."""
        return course_of(self.experiment.plant, self.reference, self.experiment.loop.period)

    @property
    def desired(self) -> JointReference:
        """Desired joint motion when the states were measured, each shape (N, n)."""
        known = self.reference
        motion = JointReference(known.position, known.velocity, known.acceleration)
        then: JointReference = at_measurement.py_func(  # type: ignore[attr-defined]
            motion, self.age
        )
        return then

    @property
    def phases(self) -> NDArray[np.int64]:
        """What the identification of the delay is doing after each row, shape (N,)."""
        return phases(self.experiment.control.setup.estimator.lock_in, self.run.fault)

    @property
    def delay(self) -> NDArray[np.float64]:
        """Age of the states that their stamps do not tell, as the controller knew, shape (N, 1).

        [s]
        """
        estimator = self.experiment.control.setup.estimator
        outcome = result(estimator.lock_in)
        delay = np.full((len(self.run.fault), 1), estimator.delay)
        if outcome.end:
            delay[outcome.end :] = outcome.delay
        return delay

    @property
    def driven_out(self) -> bool:
        """Whether the robot left its workspace before the run was over."""
        return self.run.steps <= (self.experiment.loop.last_index or 0)

    @property
    def failure(self) -> str:
        """Why the run has no figures: law, time and cause; empty if it has them."""
        loop, run = self.experiment.loop, self.run
        if self.driven_out:
            last = (run.steps - 1) * loop.period
            most, fault = np.abs(run.effort).max(), self.fault_text
            cause = f'fault before: {fault}' if fault else f'under up to {most:.3g} N m'
            return f'{loop.law}: {DRIVEN_OUT} after t = {last:.3f} s, {cause}'
        reason = faults.failure(self.faults, (run.steps - 1) * loop.period)
        return reason and f'{loop.law}: {reason}'

    @property
    def fault(self) -> tuple[float, Fault] | None:
        """Time [s] and kind of the fault that the controller entered, if any."""
        faulty = np.flatnonzero(self.run.fault)
        if not faulty.size:
            return None
        known = faults.of(self.experiment.trajectory.robot.module)
        fault = known[int(self.run.fault[faulty[0]])]
        return float(faulty[0] * self.experiment.loop.period), fault

    @property
    def fault_text(self) -> str:
        """The first fault for people."""
        return next((text for _, text in self.faults), '')

    @property
    def faults(self) -> list[tuple[float, str]]:
        """When the controller entered a fault [s], and which; empty where it was cleared."""
        fault, period = self.run.fault, self.experiment.loop.period
        changes = np.flatnonzero(np.diff(fault, prepend=faults.NONE))
        return [(float(k * period), self._fault_at(int(k))) for k in changes]

    def _fault_at(self, k: int) -> str:
        """The fault at a row for people, with joint, value and limit where a joint is too fast."""
        number = int(self.run.fault[k])
        if number == faults.NONE:
            return ''
        loop, control = self.experiment.loop, self.experiment.control
        speeds, limits = np.abs(self.run.velocity[k]), np.asarray(control.setup.limits.speed)
        fast = np.flatnonzero(speeds > limits)
        if number != faults.SPEED or not fast.size:
            return faults.of(self.experiment.trajectory.robot.module)[number].text
        joint = int(fast[0])
        value, limit = apart(float(speeds[joint]), float(limits[joint]))
        return f'{loop.joints[joint]} at {value} rad/s is above safety.speed_limit, {limit} rad/s'


def samples_of(configuration: Configuration) -> int:
    """Number of samples of a run in a compiled loop.

    Raises:
        InputError: it has no end or too many, or only nodes can run it.
    """
    loop = configuration.loop
    if loop.last_index is None:
        raise InputError(ENDLESS, 'duration')
    if loop.last_index > MAX_SAMPLES:
        raise InputError(
            f'duration must be at most {MAX_SAMPLES * loop.period:g} s in a simulation, '
            f'not {loop.duration:g}',
            'duration',
        )
    if configuration.plant.parameters.engine == MUJOCO:
        raise InputError(NODES_ALONE, 'plant.engine')
    return loop.last_index + 1


def simulate(configuration: Configuration) -> Simulation:
    """Run the closed loop for its ``duration``.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot perform the motion.
        RunError: the robot left its workspace.
    """
    made = attempt(configuration)
    if made.driven_out:
        raise RunError(made.failure)
    return made


def attempt(configuration: Configuration) -> Simulation:
    """Run the closed loop for its ``duration``, or until the robot leaves its workspace.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot perform the motion.
        RunError: the robot is outside its workspace from the start.
    """
    loop = configuration.loop
    with locating(configuration.values):
        samples = samples_of(configuration)
        experiment = assemble(configuration)
    trajectory, control, plant = experiment.trajectory, experiment.control, experiment.plant
    reference = trajectory.sample(np.arange(samples) * loop.period)
    run(control, plant, trajectory.sample(0.0), loop.period)  # compiles the loop, or loads it
    begun = time.perf_counter()
    result = run(control, plant, reference, loop.period)
    loop_time = time.perf_counter() - begun
    if not result.steps:
        raise RunError(f'{loop.law}: {DRIVEN_OUT} from the start')
    if result.steps < samples:
        reference = trajectory.sample(np.arange(result.steps) * loop.period)
        result = head(result)
    return Simulation(configuration, experiment, reference, result, loop_time)
