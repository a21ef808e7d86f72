"""The plant with MuJoCo in the place of the equations of motion; the rest is the suite's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import entry_point, vector
from parallel_robot_model.robots.joint_load import net_torque
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.mujoco_model import MujocoRobot
from parallel_robot_sim.plant import MUJOCO, PlantState, torques
from parallel_robot_sim.plant_core import update_demand
from parallel_robot_sim.plant_run import Simulator

MAX_STEP = 5e-4  # s, step of MuJoCo: within 3e-12 of the equations of motion over a second


class MujocoSimulator(Simulator):
    """Motors, sensors, friction and disturbances as ever; MuJoCo moves the bodies."""

    def __init__(self, configuration: Configuration) -> None:
        """Put the robot at rest at its initial pose.

        Raises:
            InputError: MuJoCo is not installed or cannot build the robot, or the robot does not
                reach that pose.
        """
        super().__init__(configuration)
        still = [0.0] * len(configuration.loop.joints)  # friction is the suite's
        pose = np.array(configuration.plant.initial_pose)
        step = self._period / max(2, math.ceil(self._period / MAX_STEP))
        self._bodies = _bodies(self.robot, pose, still, step)
        state, torque = self.state, self.state.torque
        self._torques = entry_point(torques, self._setup, state, torque, self._period)
        self._take = entry_point(update_demand, self._core, np.zeros(len(torque)), True)
        self._net = entry_point(net_torque, self._setup.load, torque, torque, 0.0)

    def _step(self, command: np.ndarray, arrived: bool) -> bool:
        state = self.state
        self._take(self._core, command, arrived)
        torque, acting = self._torques(self._setup, state, self._core.demand, self._period)

        def load(velocity: Array, time: float) -> Array:
            net: Array = self._net(self._setup.load, acting, vector(velocity), time)
            return np.array(net)

        self._bodies.advance_under(load, self._period)
        coordinates, rate = self._bodies.motion
        if not (np.isfinite(coordinates).all() and np.isfinite(rate).all()):
            return False
        self._state.value = PlantState(coordinates, rate, torque, state.time + self._period)
        return True


def _bodies(robot: RobotModel, pose: Array, friction: Sequence[float], step: float) -> Any:
    """The robot in MuJoCo, see MujocoRobot."""
    if not hasattr(robot.module, 'mechanism'):
        return MujocoRobot(robot, pose, friction, step)
    from parallel_robot_sim.mujoco_machine import MujocoMachine  # it takes long to load

    return MujocoMachine(robot, pose, friction, step)


def simulator_of(configuration: Configuration) -> Simulator:
    """The simulator that ``plant.engine`` names, at its initial pose.

    Raises:
        InputError: it cannot be built.
    """
    known = MujocoSimulator if configuration.plant.engine == MUJOCO else Simulator
    return known(configuration)
