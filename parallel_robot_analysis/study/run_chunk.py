"""Runs of one law in one scenario, and their metrics.

:func:`run_chunk` is the one place where the runs of a study are computed; a kernel that steps many
runs side by side goes into it.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from parallel_robot_analysis import metrics
from parallel_robot_analysis.commands.simulate import Simulated
from parallel_robot_analysis.metrics import Metrics, Poses
from parallel_robot_base.errors import DRIVEN_OUT, ParallelRobotError, RunError, first_line
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import assembly as control
from parallel_robot_control.assembly import Control
from parallel_robot_control.messages import limits_text
from parallel_robot_model import poses as forward
from parallel_robot_sim.assembly import Experiment, assemble_plant
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import Configuration
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
    """

    status: Status
    reason: str = ''
    limits: str = ''
    metrics: Metrics | None = None


@dataclass(frozen=True)
class Motion:
    """A desired motion that the robot can perform: its samples and the poses of their joints."""

    reference: Reference
    poses: np.ndarray


def run_chunk(configurations: Sequence[Configuration]) -> list[Outcome]:
    """Run experiments and measure them as ``analyze`` measures their bags.

    Args:
        configurations: Experiments of one law in one scenario, which share what they do not
            change, see configurations.py.

    Returns:
        One outcome for each; a run that fails does not stop the others.
    """
    outcomes = []
    controller: Control | None = None
    for k, configuration in enumerate(configurations):
        try:
            if controller is None or configuration.control is not configurations[k - 1].control:
                controller = control.assemble(configuration.control)
            outcomes.append(_run(configuration, controller))
        except Exception as error:  # custom laws raise anything
            outcomes.append(failed(error))
            controller = None
    return outcomes


def failed(error: Exception) -> Outcome:
    """The outcome of a run that raised an error."""
    known = isinstance(error, ParallelRobotError)
    return Outcome('failed', str(error) if known else first_line(error))


def _run(configuration: Configuration, controller: Control) -> Outcome:
    """Run one experiment.

    Raises:
        InputError: a value is wrong, or the robot cannot perform the motion.
        KinematicsError: a state has no pose.
        RunError: the robot left its workspace.
    """
    loop, trajectory = configuration.loop, configuration.trajectory
    nominal, guess = configuration.control.robot, configuration.control.guess
    last = loop.last_index or 0
    plant = assemble_plant(configuration.plant)
    motion = _motion(trajectory, loop.period, last, tuple(guess.tolist()))
    result = run(controller, plant, motion.reference, loop.period)
    if result.steps <= last:
        raise RunError(f'{DRIVEN_OUT} after t = {(result.steps - 1) * loop.period:.3f} s')
    made = Simulation(
        Experiment(loop, trajectory, controller, plant), motion.reference, result, 0.0
    )
    time = loop.period_ns * np.arange(last + 1) / NANOSECONDS  # as stamps tell it
    joints = Simulated(time, result.position, motion.reference.position, result.effort)
    actual = forward.poses_of(nominal, result.position, motion.poses[0])
    found = metrics.evaluate(joints, Poses(actual, motion.poses, nominal.module.PLANAR))
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
