"""The plant as an object: the true robot of a configuration, advanced command by command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_base import cdr, config
from parallel_robot_base.errors import RunError
from parallel_robot_base.kernel import entry_point
from parallel_robot_base.loop import LoopParameters
from parallel_robot_control.safety import SafetyParameters, safe_action, safe_torque
from parallel_robot_control.wire import wire_of
from parallel_robot_model.planar_3rrr.parameters import RobotParameters, validate
from parallel_robot_sim.disturbance import DisturbanceParameters
from parallel_robot_sim.friction import FrictionParameters
from parallel_robot_sim.messages import state_layout
from parallel_robot_sim.plant import (
    Measurement,
    PlantParameters,
    PlantState,
    initial_state,
    measure,
    stepping,
)
from parallel_robot_sim.plant_core import advance, plant_core, read_command, tell

GROUPS = {
    'true_robot': RobotParameters,
    'plant': PlantParameters,
    'friction': FrictionParameters,
    'disturbance': DisturbanceParameters,
    'safety': SafetyParameters,
}


class Simulator:
    """The true robot, its friction, its motors and its state.

    Attributes:
        robot: The true robot.
        friction: Its friction.
        disturbance: What disturbs it.
        stepping: Integrator and motors.
        layout: Of its messages.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Put the robot of a resolved configuration at rest at its initial pose.

        Raises:
            InputError: a value is wrong, or a leg does not reach the initial pose.
        """
        loop = config.group(values, LoopParameters, '')
        parameters = config.group(values, PlantParameters, 'plant')
        self.robot = validate(config.group(values, RobotParameters, 'true_robot'), 'true_robot')
        self.friction = config.group(values, FrictionParameters, 'friction')
        self.disturbance = config.group(values, DisturbanceParameters, 'disturbance')
        self.stepping = stepping(parameters)
        safety = config.group(values, SafetyParameters, 'safety')
        self._safe = safe_action(parameters.timeout_action, safety)
        self._patience = max(1, round(parameters.command_timeout / loop.period))
        self._silent = 0  # steps since the last command
        self._held: np.ndarray = np.zeros(3)
        self.layout = state_layout(loop.joints, parameters.publish_passive)
        draft = self.layout.draft()
        self._message = draft.bytes
        start = initial_state(parameters, self.robot)
        self._state = (start.pose, start.rate, start.torque, np.array([start.time]))
        self._core = plant_core(
            self.stepping,
            self.robot,
            self.friction,
            self.disturbance,
            loop.period,
            *self._state,
            self._message[4:12].view(np.int32),
            *(draft.fields[name] for name in ('position', 'velocity', 'effort')),
        )
        self._wire = wire_of(cdr.float64_multi_array(3), ('data',), range(3))
        self._read = entry_point(read_command, self._wire, b'', np.zeros(3))
        self._advance = entry_point(advance, self._core, np.zeros(3))
        self._tell = entry_point(tell, self._core, 0)

    @property
    def state(self) -> PlantState:
        """State now."""
        pose, rate, torque, time = (values.copy() for values in self._state)
        return PlantState(pose, rate, torque, float(time[0]))

    @property
    def pose(self) -> np.ndarray:
        """Pose now, shape (3,)."""
        return self._state[0].copy()

    def warm(self) -> None:
        """Compile what has not been; the robot moves on by a period without torque."""
        self.wait(np.zeros(3))

    def read(self, data: bytes, command: np.ndarray) -> bool:
        """Read a command message into `command` [N m], shape (3,).

        Returns:
            Whether it is one as the suite writes it, of finite torques; else nothing is read.
        """
        understood: bool = self._read(self._wire, data, command)
        return understood

    def advance(self, command: np.ndarray) -> None:
        """Advance by one period under a command [N m], shape (3,).

        Raises:
            RunError: the robot was driven out of its workspace; it stays where it was.
        """
        if not self._advance(self._core, command):
            raise RunError(
                'the robot was driven out of its workspace at pose '
                f'{np.round(self._state[0], 4).tolist()} (m, m, rad)'
            )
        self._silent = 0

    def wait(self, command: np.ndarray) -> bool:
        """Advance by one period for which no new command came.

        Args:
            command: The last one [N m], shape (3,); it holds until the time-out.

        Returns:
            Whether the safe action of the motors begins with this period.

        Raises:
            RunError: the robot was driven out of its workspace.
        """
        self._silent += 1
        joints = self.measurement()
        if self._silent == self._patience:
            self._held = joints.theta
        safe = safe_torque(self._safe, self._held, joints.theta, joints.theta_dot)
        if self._silent >= self._patience:
            command = safe
        silent = self._silent
        self.advance(command)
        self._silent = silent
        return silent == self._patience

    def measurement(self) -> Measurement:
        """Joints at the state."""
        return measure(self.robot, self.state)

    def message(self, stamp: int) -> bytes:
        """The state as a sensor_msgs/JointState; `stamp` in nanoseconds.

        Raises:
            RunError: the robot was driven out of its workspace.
        """
        if not self._tell(self._core, stamp):
            raise RunError('the robot was driven out of its workspace')
        return self._message.tobytes()
