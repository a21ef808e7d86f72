"""Runs of one law in one scenario, side by side where possible, and their metrics."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from parallel_robot_analysis import metrics
from parallel_robot_analysis.metrics import Metrics, Poses
from parallel_robot_analysis.simulated_motion import SimulatedMotion
from parallel_robot_base.errors import DRIVEN_OUT, ParallelRobotError, RunError, first_line
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import assembly as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.messages import limits_text
from parallel_robot_model import poses as forward
from parallel_robot_sim.assembly import Experiment, assemble_plant
from parallel_robot_sim.closed_loop import ClosedLoopRun, run
from parallel_robot_sim.closed_loops import LANES, run_side_by_side
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.simulation import Simulation
from parallel_robot_studies.ideal_torque import torque_of
from parallel_robot_studies.sweep.floor import Floor
from trajectory_gen import preflight
from trajectory_gen.trajectory import Reference, Trajectory

Status = Literal['ok', 'fault', 'failed']
log = logging.getLogger(__name__)
_ALONE: set[str] = set()  # laws that do not run side by side


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes:
        status: ok; fault: the controller took its safe action; failed: there are no metrics.
        reason: Why it is not ok; empty if it is.
        limits: Limits that acted.
        metrics: Metrics of the run.
        floor: Limit of its sample, where it was asked for.
    """

    status: Status
    reason: str = ''
    limits: str = ''
    metrics: Metrics | None = None
    floor: Floor | None = None


@dataclass(frozen=True)
class Motion:
    """A desired motion that the robot can perform: its samples and the poses of their joints."""

    reference: Reference
    poses: np.ndarray


class Prepared(NamedTuple):
    """A run before its first sample.

    Attributes:
        place: Its place in the chunk.
        configuration: Its configuration.
        experiment: It, put together.
        motion: Its desired motion.
    """

    place: int
    configuration: Configuration
    experiment: Experiment
    motion: Motion


def run_chunk(configurations: Sequence[Configuration]) -> list[Outcome]:
    """Run experiments and measure them as ``analyze`` measures their bags.

    Where the sensors of the plant are not ideal, the metrics are of the true motion.

    Args:
        configurations: Experiments of one law in one scenario, which share what they do not
            change, see configurations.py.

    Returns:
        One outcome for each; a run that fails does not stop the others.
    """
    outcomes: dict[int, Outcome] = {}
    prepared: list[Prepared] = []
    controller: Control | None = None
    for k, configuration in enumerate(configurations):
        try:
            if controller is None or configuration.control is not configurations[k - 1].control:
                controller = control.assemble(configuration.control)
            prepared.append(_prepare(k, configuration, controller))
        except Exception as error:  # custom laws raise anything
            outcomes[k] = failed(error)
            controller = None
    for first in range(0, len(prepared), LANES):
        part = prepared[first : first + LANES]
        for each, record in zip(part, _records(part), strict=True):
            try:
                result = record if isinstance(record, ClosedLoopRun) else record()
                outcomes[each.place] = _measured(each, result)
            except Exception as error:
                outcomes[each.place] = failed(error)
    return [outcomes[k] for k in range(len(configurations))]


def failed(error: Exception) -> Outcome:
    """The outcome of a run that raised an error."""
    known = isinstance(error, ParallelRobotError)
    return Outcome('failed', str(error) if known else first_line(error))


def _prepare(place: int, configuration: Configuration, controller: Control) -> Prepared:
    """Put one run together.

    Raises:
        InputError: a value is wrong, or the robot cannot perform the motion.
        KinematicsError: a state of the desired motion has no pose.
    """
    loop, trajectory = configuration.loop, configuration.trajectory
    plant = assemble_plant(configuration.plant)
    guess = configuration.control.guess
    motion = _motion(trajectory, loop.period, loop.last_index or 0, tuple(guess.tolist()))
    return Prepared(place, configuration, Experiment(loop, trajectory, controller, plant), motion)


def _records(part: list[Prepared]) -> list[ClosedLoopRun | Callable[[], ClosedLoopRun]]:
    """The runs side by side, or, where that is not possible, how to run each of them alone."""
    law = part[0].experiment.control.law.name
    same = all(each.motion is part[0].motion for each in part)
    if len(part) == LANES and same and law not in _ALONE:
        try:
            experiments = [each.experiment for each in part]
            return [*run_side_by_side(experiments, part[0].motion.reference, complete=False)]
        except Exception as error:  # a custom law that branches, or works with arrays
            log.debug('%s: run one by one: %s', law, first_line(error))
            _ALONE.add(law)
    return [functools.partial(_alone, each) for each in part]


def _alone(each: Prepared) -> ClosedLoopRun:
    experiment = each.experiment
    period = experiment.loop.period
    return run(experiment.control, experiment.plant, each.motion.reference, period)


def _measured(each: Prepared, result: ClosedLoopRun) -> Outcome:
    """Metrics of a run.

    Raises:
        KinematicsError: a state has no pose.
        RunError: the robot left its workspace.
    """
    configuration, experiment, motion = each.configuration, each.experiment, each.motion
    loop, nominal = configuration.loop, configuration.control.robot
    last = loop.last_index or 0
    if result.steps <= last:
        raise RunError(f'{DRIVEN_OUT} after t = {(result.steps - 1) * loop.period:.3f} s')
    made = Simulation(experiment, motion.reference, result, 0.0)
    time = loop.period_ns * np.arange(last + 1) / NANOSECONDS  # as stamps tell it
    joints = SimulatedMotion(time, result.joints, motion.reference.position, result.effort)
    actual = forward.poses_of(nominal, result.joints, motion.poses[0])
    poses = Poses(actual, motion.poses, nominal.module.PLANAR)
    found = metrics.evaluate(joints, poses, torque_of(configuration))
    acted = int(np.bitwise_or.reduce(result.acted))
    limits = limits_text(acted) if acted else ''
    if made.fault is not None:
        begin, fault = made.fault
        return Outcome('fault', f'fault at t = {begin:.3f} s: {fault.text}', limits, found)
    return Outcome('ok', '', limits, found)


@functools.lru_cache(maxsize=2)
def _motion(trajectory: Trajectory, period: float, last: int, guess: tuple[float, ...]) -> Motion:
    """The motion of a trajectory, checked and sampled once for all runs that share it."""
    preflight.check(trajectory, period)
    reference = trajectory.sample(np.arange(last + 1) * period)
    poses = forward.poses_of(trajectory.robot, reference.position, np.array(guess))
    return Motion(reference, poses)
