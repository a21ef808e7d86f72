"""The true motion behind noise and delays: the plant moves once more, window by window."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.bags.experiment import SIMULATION
from parallel_robot.bags.history import History
from parallel_robot.bags.run.run_log import RunLog, TopicCount
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.errors import ParallelRobotError, WholeNeededError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import COMMANDS, REFERENCE
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.motions import Located, Motion
from parallel_robot_sim.plant import MUJOCO
from parallel_robot_sim.plant_again import UnderCommands
from trajectory_gen.configuration import trajectory_of

MESSAGES = REFERENCE, COMMANDS  # that are counted
SAME = 1e-9  # rad, to which a plant that moves again tells the same
FEW = 1e-3  # share of its states that may differ: steps of an encoder on another processor


class PlantWindows:
    """The true motion of a bag, in parts; what is special needs the whole bag."""

    def __init__(self, bag: Path, values: Mapping[str, Any], past: History) -> None:
        """Put the plant together.

        Args:
            bag: The bag, for error messages.
            values: Its configuration.
            past: What it says beside the motion.

        Raises:
            WholeNeededError: its plant cannot move again in windows.
        """
        self._bag, self._simulated = bag, past.facts.get('source') == SIMULATION
        try:
            configuration = configure_plant(values)
            self._plant = UnderCommands(configuration)
            self._trajectory = trajectory_of(values)
            nominal, guess = nominal_of(values)
            self._located = Located(nominal, robot_of(values, 'true_robot'), guess)
        except ParallelRobotError as error:
            raise self._whole(str(error)) from None
        loop = configuration.loop
        special = configuration.parameters.engine == MUJOCO or values.get('hazards')
        if special or not (self._simulated or loop.lockstep):
            raise self._whole('it is no simulation without hazards')
        self._tick, self._period, self._age = loop.period_ns, loop.period, reported_age(values)
        self._moved = self._differing = self._references = self._commands = 0
        self._over = False  # the last state had no answer

    def of(self, log: RunLog) -> Motion:
        """The true motion at the states of the next window.

        Raises:
            WholeNeededError: a state or its answer is not there, or there is no pose.
        """
        measured = np.rint((log.stamps + self._age - log.start_stamp) / self._tick).astype(int)
        samples = self._moved + np.arange(len(measured))
        torque = log.answer.copy()
        if np.isnan(torque[-1]).any():  # perhaps the last one of all, after which nothing moves
            torque[-1] = 0.0
        if not np.array_equal(measured, samples) or np.isnan(torque).any() or self._over:
            raise self._whole('it lacks states or commands')
        self._over = bool(np.isnan(log.answer[-1]).any())
        joints, told, effort = self._plant.moved(torque)
        if len(joints) < len(samples):
            raise self._whole('its plant does not move on')
        self._moved += len(joints)
        apart = np.abs(told - log.position).max(axis=1)
        self._differing += int((apart > SAME).sum())
        nothing = TopicCount(0, 0)
        references, commands = (log.messages.get(each.name, nothing) for each in MESSAGES)
        self._references += references.count + references.missing
        self._commands += commands.count
        wanted = self._trajectory.sample(samples * self._period).position
        try:
            poses = self._located.poses(wanted, joints)
        except ParallelRobotError as error:
            raise self._whole(str(error)) from None
        return Motion(self._tick * samples / NANOSECONDS, joints, wanted, effort, poses)

    def check(self) -> None:
        """Refuse a plant that was another one than that of the bag, at its end.

        Raises:
            WholeNeededError: it was, or the bag lacks states at its end.
        """
        if self._simulated and self._moved != self._references:
            raise self._whole('it lacks states')
        if self._commands < self._moved - self._over:
            raise self._whole('it lacks commands')
        if self._differing > FEW * self._moved:
            raise self._whole('its plant is another one')

    def _whole(self, reason: str) -> WholeNeededError:
        return WholeNeededError(f'{self._bag}: {reason}: its plant moves again as a whole alone')
