"""A run of the closed loop without ROS, from its configuration."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.assembly import inertia_of
from parallel_robot_control.contract import JointReference
from parallel_robot_control.estimation.estimator import MEASURED, kind_for
from parallel_robot_control.estimation.lock_in import phases
from parallel_robot_control.reference_buffer import extrapolated
from parallel_robot_control.safety import checks, faults
from parallel_robot_model.common.errors import DRIVEN_OUT, InputError, RunError, distinct_texts
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.robots.contract import Fault
from parallel_robot_model.robots.registry import units_of
from parallel_robot_sim.closed_loop import (
    ClosedLoopRun,
    final_state,
    head,
    initial_state,
    run,
    run_part,
)
from parallel_robot_sim.configuration import Configuration, Experiment, assemble
from parallel_robot_sim.plant import MUJOCO
from parallel_robot_sim.timeline import Timeline, timeline_of
from trajectory_gen.trajectory import Reference

# For how long the motors of a plant gave all they can.

SATURATED = 'the motors were at their limit (plant.torque_limit, {0} {2}) in {1} % of the samples'


def saturation(values: Mapping[str, Any], effort: np.ndarray) -> list[str]:
    """A line that says for how long the motors of the plant gave all they can, if they did.

    Args:
        values: The resolved configuration.
        effort: Torques of the motors [N m], shape (N, n).
    """
    return saturation_of(values, int(saturated(values, effort).sum()), len(effort))


def saturated(values: Mapping[str, Any], effort: np.ndarray) -> np.ndarray:
    """At which samples the motors gave all they can, shape (N,); see :func:`saturation`."""
    limit, forward, backward = (
        np.asarray(values[f'plant.torque_{each}'], np.float64)
        for each in ('limit', 'forward', 'backward')
    )
    if limit.size not in (1, effort.shape[1]):  # of a bag; such a plant cannot be built
        return np.zeros(len(effort), bool)
    at_end = (effort >= forward * limit) | (effort <= -backward * limit)
    reached: np.ndarray = (at_end & (effort != 0.0)).any(axis=1)
    return reached


def saturation_of(values: Mapping[str, Any], count: int, of: int) -> list[str]:
    """The line of :func:`saturation`, for so many samples of so many."""
    if not count:
        return []
    limit = np.asarray(values['plant.torque_limit'], np.float64)
    texts = ', '.join(f'{each:g}' for each in (limit if np.ptp(limit) else np.unique(limit)))
    return [SATURATED.format(texts, f'{100.0 * (count / of):.3g}', units_of(values).of('N m'))]


MAX_SAMPLES = 5_000_000  # samples of a simulation that keeps all of them in memory
LONGEST = 360_000_000  # samples of one that does not: a hundred hours at 1 kHz
AT_ONCE = 20_000  # samples of a part of it
ENDLESS = 'duration must be positive: a run needs an end'
NODES_ALONE = (
    'plant.engine must be analytic in a compiled loop, not mujoco: that is for the nodes, '
    'parallel_robot run --time-mode lockstep'
)


class Simulation(NamedTuple):
    """A run with its experiment, or a part of one."""

    configuration: Configuration
    experiment: Experiment  # the experiment that was run
    reference: Reference  # desired motion, one row per state
    run: ClosedLoopRun  # record of the run
    loop_time: float  # time spent in the loop [s]
    first: int = 0  # sample of the first row
    # sample of the first fault until the last row; None without one
    first_fault: int | None = None
    # rows at which a fault was not cleared, and the fault that is the reason
    refused: tuple[tuple[int, int], ...] = ()

    @property
    def age(self) -> float:
        """Age of the states that their stamps tell [s]."""
        age: float = self.experiment.plant.setup.imperfections.age
        return age

    @property
    def timeline(self) -> Timeline:
        """What hazards made of the course of the run."""
        period = self.experiment.loop.period
        return timeline_of(self.experiment.plant, self.reference, period, self.first)

    @property
    def desired(self) -> JointReference:
        """Desired joint motion when the states were measured, each shape (N, n)."""
        known = self.reference
        motion = JointReference(known.position, known.velocity, known.acceleration)
        then: JointReference = extrapolated.py_func(  # type: ignore[attr-defined]
            motion, -self.age
        )
        return then

    @property
    def phases(self) -> NDArray[np.int64]:
        """What the identification of the delay is doing after each row, shape (N,)."""
        samples = self.first + np.arange(len(self.run.fault))
        return phases(self.experiment.control.setup, samples, self.first_fault)

    @property
    def summary(self) -> RunSummary:
        """Summary of the whole run."""
        summary = RunSummary()
        summary.add(self)
        return summary

    @property
    def driven_out(self) -> bool:
        """Whether the robot left its workspace before the run was over."""
        return self.first + self.run.steps <= (self.experiment.loop.last_index or 0)

    @property
    def failure(self) -> str:
        """Why the run has no figures: law, time and cause; empty if it has them."""
        return self.summary.failure

    @property
    def fault(self) -> tuple[float, Fault] | None:
        """Time [s] and kind of the fault that the controller entered, if any."""
        faulty = np.flatnonzero(self.run.fault)
        if not faulty.size:
            return None
        fault = self._fault(int(self.run.fault[faulty[0]]))
        return float(faulty[0] * self.experiment.loop.period), fault

    def _fault(self, number: int) -> Fault:
        """A fault of this run; of a foreign law, with what became of it."""
        fault = faults.of(self.experiment.trajectory.robot.module)[number]
        return self.experiment.control.law.explain(fault)

    def refusal(self, number: int) -> str:
        """Why a fault was not cleared, by the number of the fault whose cause is there."""
        return self._fault(number).text

    @property
    def fault_text(self) -> str:
        """The first fault for people."""
        return self.summary.fault_text

    @property
    def faults(self) -> list[tuple[float, str]]:
        """When the controller entered a fault [s], and which; empty where it was cleared."""
        return self.summary.faults

    def fault_at(self, k: int) -> str:
        """The fault at a row for people, with joint, value and limit where a joint is too fast."""
        number = int(self.run.fault[k])
        if number == faults.NONE:
            return ''
        loop, control = self.experiment.loop, self.experiment.control
        speeds, limits = np.abs(self.run.velocity[k]), np.asarray(control.setup.safety.speed_limit)
        fast = np.flatnonzero(speeds > limits)
        if number != faults.SPEED or not fast.size:
            return self._fault(number).text
        joint = int(fast[0])
        value, limit = distinct_texts(float(speeds[joint]), float(limits[joint]))
        unit = self.experiment.trajectory.robot.joint_units.one(joint).of('rad/s')
        return (
            f'{loop.joints[joint]} at {value} {unit} is above safety.speed_limit, {limit} {unit}'
        )


class RunSummary:
    """Summary of a whole run, from its parts."""

    def __init__(self) -> None:
        self.steps = 0  # number of its rows
        # when the controller entered a fault [s], and which; empty where it was cleared
        self.faults: list[tuple[float, str]] = []
        self.refused: list[tuple[float, str]] = []  # when one was not cleared [s], and why
        self.active_limits = 0  # bits of all limits that acted
        self.phase = 0  # what the identification of the delay was doing at the end
        self.loop_time = 0.0  # time spent in the loop [s]
        self._loop: LoopParameters | None = None
        self._fault = faults.NONE  # at the last row
        self._most = 0.0  # N m, of the motors
        self._torque = 'N m'  # unit of torques
        self.saturated = 0  # rows at which a motor gave all it can

    def add(self, part: Simulation) -> None:
        """Take the next part."""
        run, loop = part.run, part.experiment.loop
        changes = np.flatnonzero(np.diff(run.fault, prepend=self._fault))
        self.faults += [
            (float((part.first + k) * loop.period), part.fault_at(int(k))) for k in changes
        ]
        self.refused += [
            ((part.first + k) * loop.period, part.refusal(number)) for k, number in part.refused
        ]
        self.saturated += int(saturated(part.configuration.values, run.effort).sum())
        self._most = max(self._most, float(np.abs(run.effort).max()))
        self._loop, self._fault = loop, int(run.fault[-1])
        self._torque = part.experiment.trajectory.robot.joint_units.of('N m')
        self.active_limits |= int(np.bitwise_or.reduce(run.active_limits))
        self.phase = int(part.phases[-1])
        self.loop_time += part.loop_time
        self.steps += run.steps

    def taken(self, parts: Iterable[Simulation]) -> Iterator[Simulation]:
        """Pass parts on, each when it is taken."""
        for part in parts:
            self.add(part)
            yield part

    @property
    def duration(self) -> float:
        """Time of the last row [s]."""
        return (self.steps - 1) * (self._loop.period if self._loop else 0.0)

    @property
    def fault_text(self) -> str:
        """The first fault for people."""
        return next((text for _, text in self.faults), '')

    @property
    def failure(self) -> str:
        """Why the run has no figures: law, time and cause; empty if it has them."""
        loop = self._loop
        assert loop is not None
        if self.steps <= (loop.last_index or 0):
            fault = self.fault_text
            cause = (
                f'fault before: {fault}'
                if fault
                else f'under up to {self._most:.3g} {self._torque}'
            )
            return f'{loop.law}: {DRIVEN_OUT} after t = {self.duration:.3f} s, {cause}'
        reason = faults.failure(self.faults, self.duration)
        return reason and f'{loop.law}: {reason}'


def samples_of(configuration: Configuration, most: int = MAX_SAMPLES) -> int:
    """Number of samples of a run in a compiled loop.

    Args:
        configuration: The configuration.
        most: The largest number; default: where all of them are kept in memory.

    Raises:
        InputError: it has no end or too many, or only nodes can run it.
    """
    loop = configuration.loop
    if loop.last_index is None:
        raise InputError(ENDLESS, 'duration')
    if loop.last_index > most:
        kept = ', where all samples are kept in memory' if most == MAX_SAMPLES else ''
        raise InputError(
            f'duration must be at most {most * loop.period:g} s in a simulation{kept}, '
            f'not {loop.duration:g}',
            'duration',
        )
    if configuration.plant.engine == MUJOCO:
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
    with with_location(configuration.values):
        samples = samples_of(configuration)
    return next(parts(configuration, samples))


def parts(configuration: Configuration, size: int | None = None) -> Iterator[Simulation]:
    """Run the closed loop as :func:`attempt` does, in parts that follow one another.

    A part is as long as `size`; the first one has all that hazards do.

    Args:
        configuration: The configuration.
        size: Number of samples of a part; default: AT_ONCE.

    Raises:
        InputError: a value is wrong, the duration is zero, or the robot cannot perform the motion.
        RunError: the robot is outside its workspace from the start.
    """
    loop, period = configuration.loop, configuration.loop.period
    with with_location(configuration.values):
        samples = samples_of(configuration, LONGEST)
        experiment = assemble(configuration, min(samples, size or AT_ONCE))
    trajectory, control, plant = experiment.trajectory, experiment.control, experiment.plant
    known = experiment.first_samples
    run(control, plant, trajectory.sample(0.0), period)  # compiles the loop, or loads it
    state = initial_state(control, plant)
    first, first_fault = 0, None
    while first < samples:
        stop = min(samples, max(first + (size or AT_ONCE), plant.hazards.undisturbed_from))
        if known is not None and stop == len(known.pose):
            reference, known = known, None
        else:
            reference = trajectory.sample(np.arange(first, stop) * period)
        begun = time.perf_counter()
        refused: list[tuple[int, int]] = []
        seen = timeline_of(plant, reference, period, first)
        made = run_part(control, plant, seen, state, period, first, refused=refused)
        loop_time = time.perf_counter() - begun
        if not first + made.steps:
            raise RunError(f'{loop.law}: {DRIVEN_OUT} from the start')
        driven_out = made.steps < stop - first
        if driven_out:
            reference = trajectory.sample(np.arange(first, first + made.steps) * period)
            made = head(made)
        faulty = np.flatnonzero(made.fault)
        if first_fault is None and faulty.size:
            first_fault = first + int(faulty[0])
        if made.steps:
            yield Simulation(
                configuration,
                experiment,
                reference,
                made,
                loop_time,
                first,
                first_fault,
                tuple(refused),
            )
        if driven_out:
            break
        state, first = final_state(made), stop


# What does not suit the sensors or the period, which no controller knows but a simulation.


def plant_warnings(configuration: Configuration) -> tuple[str, ...]:
    """What of the plant does not suit the law or the period, one line each; often nothing."""
    return noise_warnings(configuration) + friction_warnings(configuration)


def friction_warnings(configuration: Configuration) -> tuple[str, ...]:
    """A line on the joints that dry friction may stop and turn between two samples.

    In a period of h, dry friction F of joint j changes its rate by h F [M^-1]_jj. At most half of
    that, times the time for which :func:`checks.inconsistent` adds them up, are the ways that the
    sampled rates do not tell; faults were seen from a fifth of it on.
    """
    friction, control = configuration.joint_load.friction, configuration
    dry = np.add(friction.coulomb, np.maximum(friction.stribeck, 0.0))
    tolerance = control.safety.rate_tolerance
    if not (tolerance and dry.any()):
        return ()
    M = inertia_of(control)
    if not M[0, 0] > 0.0:  # a pose in which the robot has no model
        return ()
    changes = configuration.loop.period * dry * np.diag(np.linalg.inv(M))
    untold = 0.5 * checks.WINDOW * changes
    stiff = int(np.sum(0.2 * untold > tolerance))
    if not stiff:
        return ()
    worst = int(np.argmax(untold))
    change = f'{changes[worst]:.2g} {control.robot.joint_units.one(worst).of("rad/s")}'
    others = f' (and {stiff - 1} more)' if stiff > 1 else ''
    return (
        f'{configuration.loop.joints[worst]}{others}: dry friction changes the rate by {change} '
        'in one period; it stops and turns between two samples, which few laws master: inertia '
        'too small (robot.armature is that of the motor), or friction too large',
        f'safety.rate_tolerance, {tolerance:g}, may take that friction for wrong rates; '
        f'{1.1 * untold[worst]:.2g} does not',
    )


def noise_warnings(configuration: Configuration) -> tuple[str, ...]:
    """What the active law says of the noise of the velocities that it is given.

    Nothing where they are estimated or differentiated: their noise is another one.
    """
    sensor = configuration.imperfections.sensor
    name = configuration.loop.law
    law = configuration.laws[name]
    measured = kind_for(configuration.estimator, law) in MEASURED
    if not measured or sensor.differentiate:
        return ()
    noise = float(np.max(sensor.velocity_noise))
    if not noise:
        return ()
    warnings = law.noise_warnings(configuration.gains[name], noise, configuration.loop.period)
    return tuple(f'{name}: {text}' for text in warnings)
