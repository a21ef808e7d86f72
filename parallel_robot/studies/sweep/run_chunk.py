"""Runs of one law in one scenario, and their metrics."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from parallel_robot.analysis import metrics
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.studies.limit.calm import Calm
from parallel_robot.studies.sweep.floor import Floor
from parallel_robot_control import assembly as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.messages import limits_text
from parallel_robot_model.common.errors import DRIVEN_OUT, ParallelRobotError, RunError, first_line
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import Configuration, Experiment, assemble_plant
from parallel_robot_sim.motions import of_simulation
from parallel_robot_sim.simulation import Simulation
from trajectory_gen import preflight
from trajectory_gen.trajectory import Reference, Trajectory

Status = Literal['ok', 'fault', 'failed']


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes:
        status: ok; fault: the controller took its safe action; failed: there are no metrics.
        reason: Why it is not ok; empty if it is.
        limits: Limits that acted.
        metrics: Metrics of the run.
        floor: Limit of its sample, where it was asked for.
        calm: Limit of its sample by chattering, where it was asked for and there is one.
    """

    status: Status
    reason: str = ''
    limits: str = ''
    metrics: Metrics | None = None
    floor: Floor | None = None
    calm: Calm | None = None


class Prepared(NamedTuple):
    """A run before its first sample.

    Attributes:
        place: Its place in the chunk.
        configuration: Its configuration.
        experiment: It, put together.
        reference: Its desired motion.
    """

    place: int
    configuration: Configuration
    experiment: Experiment
    reference: Reference


def run_chunk(configurations: Sequence[Configuration]) -> list[Outcome]:
    """Run experiments and measure them as ``analyze`` measures their bags.

    Args:
        configurations: Experiments of one law in one scenario.

    Returns:
        One outcome for each; a run that fails does not stop the others.
    """
    outcomes: dict[int, Outcome] = {}
    prepared: list[Prepared] = []
    controller: Control | None = None
    for k, configuration in enumerate(configurations):
        try:
            if controller is None or configuration.control != configurations[k - 1].control:
                controller = control.assemble(configuration.control)
            prepared.append(_prepare(k, configuration, controller))
        except Exception as error:  # custom laws raise anything
            outcomes[k] = failed(error)
            controller = None
    for each in prepared:
        try:
            outcomes[each.place] = _measured(each)
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
    """
    loop, trajectory = configuration.loop, configuration.trajectory
    plant = assemble_plant(configuration.plant)
    reference = _reference(trajectory, loop.period, loop.last_index or 0)
    experiment = Experiment(loop, trajectory, controller, plant)
    return Prepared(place, configuration, experiment, reference)


def _measured(each: Prepared) -> Outcome:
    """Do a run and measure it.

    Raises:
        KinematicsError: a state has no pose.
        RunError: the robot left its workspace.
    """
    _, configuration, experiment, reference = each
    loop = configuration.loop
    last = loop.last_index or 0
    result = run(experiment.control, experiment.plant, reference, loop.period, complete=False)
    if result.steps <= last:
        raise RunError(f'{DRIVEN_OUT} after t = {(result.steps - 1) * loop.period:.3f} s')
    made = Simulation(configuration, experiment, reference, result, 0.0)
    found = metrics.figures(of_simulation(made))
    acted = int(np.bitwise_or.reduce(result.acted))
    limits = limits_text(acted) if acted else ''
    if made.fault is not None:
        begin, fault = made.fault
        return Outcome('fault', f'fault at t = {begin:.3f} s: {fault.text}', limits, found)
    return Outcome('ok', '', limits, found)


@functools.lru_cache(maxsize=2)
def _reference(trajectory: Trajectory, period: float, last: int) -> Reference:
    """The motion of a trajectory, checked and sampled once for all runs that share it."""
    reference = trajectory.sample(np.arange(last + 1) * period)
    preflight.check(trajectory, period, reference)
    return reference
