"""The plant as an object: the true robot of a configuration, advanced command by command."""

from __future__ import annotations

import numpy as np

from parallel_robot_control.messages import wire_of
from parallel_robot_model.common.errors import DRIVEN_OUT, RunError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.compiler import entry_point, need_compiler, vector
from parallel_robot_model.configuration.hazards import HazardTimes
from parallel_robot_model.messages import layouts
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_sim.configuration import PlantConfiguration, assemble_plant
from parallel_robot_sim.plant import PlantState
from parallel_robot_sim.plant_core import advance, plant_core, read_command, state_layout, tell


class Simulator:
    """The true robot, its friction, its motors and its state.

    Attributes:
        robot: The true robot.
    """

    def __init__(self, configuration: PlantConfiguration) -> None:
        """Put the robot at rest at its initial pose.

        Raises:
            InputError: the robot does not reach that pose, or the compiler is switched off.
        """
        need_compiler()
        loop = configuration.loop
        self.robot = robot = configuration.robot
        axes = robot.module.coordinates(robot.parameters)
        self._units = ', '.join(axis.unit for axis in axes)
        self._setup, start, hazards, _ = assemble_plant(configuration)
        age = configuration.safety.state_age
        self._times = HazardTimes(hazards, loop.period, age) if hazards else None
        self._period = loop.period
        self._patience = self._setup.patience.samples
        n = len(loop.joints)
        self._silent = np.zeros(1, np.int64)  # periods since the last command
        self._asked = np.zeros(n)  # N m, of the motors over a period
        self._state = (
            np.array(start.coordinates),
            np.array(start.rate),
            np.array(start.torque),
            np.array([start.time]),
        )
        measure = robot.module.measure
        self._measure = entry_point(measure, robot.constants, start.coordinates, start.rate)
        passive = (
            len(self.measurement().passive_position)
            if configuration.parameters.publish_passive
            else 0
        )
        draft = state_layout(loop.joints, passive).draft()
        self._message = draft.bytes
        self._core = plant_core(
            self._setup,
            loop.period,
            start,
            *self._state,
            self._silent,
            np.zeros(n),
            np.zeros(n),
            self._asked,
            self._message[4:12].view(np.int32),
            *(draft.fields[name] for name in ('position', 'velocity', 'effort')),
        )
        self._wire = wire_of(layouts.float64_multi_array(n), ('data',), range(n))
        self._read = entry_point(read_command, self._wire, b'', np.zeros(n))
        self._advance = entry_point(advance, self._core, np.zeros(n), True)
        self._tell = entry_point(tell, self._core, 0)

    @property
    def state(self) -> PlantState:
        """The present state."""
        coordinates, rate, torque, time = self._state
        return PlantState(vector(coordinates), vector(rate), vector(torque), float(time[0]))

    @property
    def pose(self) -> np.ndarray:
        """The present pose, shape (m,)."""
        return self.measurement().pose

    def warm(self) -> None:
        """Compile the kernels; the robot advances by one period without torque."""
        self.advance(np.zeros(len(self._asked)))

    def read(self, data: bytes, command: np.ndarray) -> bool:
        """Read a command message into `command` [N m], shape (n,).

        Returns:
            Whether it has the layout of the suite and finite torques; if not, nothing is read.
        """
        understood: bool = self._read(self._wire, data, command)
        return understood

    @property
    def sample(self) -> int:
        """Index of the present sample, since the start."""
        return round(float(self._state[3][0]) / self._period)

    @property
    def told(self) -> bool:
        """Whether hazards leave a message of the present state."""
        return self._times is None or self._times.is_told(self.sample)

    @property
    def answered(self) -> bool:
        """Whether hazards leave a message of the present state that a controller answers."""
        return self._times is None or self._times.is_answered(self.sample)

    @property
    def shown(self) -> bool:
        """Whether hazards leave a message of the present pose."""
        return self._times is None or self._times.is_shown(self.sample)

    def advance(self, command: np.ndarray, arrived: bool = True) -> bool:
        """Advance by one period.

        Args:
            command: The newest command [N m], shape (n,).
            arrived: Whether it is for this period; else it holds until the time-out.

        Returns:
            Whether the safe action of the motors begins with this period.

        Raises:
            RunError: the robot was driven out of its workspace; it stays where it was.
        """
        if not self._step(command, arrived):
            raise RunError(
                f'{DRIVEN_OUT} at pose {np.round(self.pose, 4).tolist()} ({self._units})'
            )
        return bool(self._silent[0] == self._patience)

    def _step(self, command: np.ndarray, arrived: bool) -> bool:
        """Advance the state; False, with the state unchanged, if the robot was driven out."""
        inside: bool = self._advance(self._core, command, arrived)
        return inside

    def measurement(self) -> Measurement:
        """Joints and pose at the present state."""
        coordinates, rate, _, _ = self._state
        joints: Measurement = self._measure(self._setup.robot, vector(coordinates), vector(rate))
        return joints

    def message(self, stamp: int) -> bytes:
        """The state as a sensor_msgs/JointState; `stamp` in nanoseconds.

        Raises:
            RunError: the robot was driven out of its workspace.
        """
        if self._times is not None:
            stamp -= self._times.late(self.sample) * round(self._period * NANOSECONDS)
        if not self._tell(self._core, stamp):
            raise RunError(DRIVEN_OUT)
        return self._message.tobytes()
