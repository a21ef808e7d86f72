"""The course of a plant: held, moving, paused, driven out, finished; one state after the other.

In wall time, :meth:`PlantRun.tick` is called for each stamp of the grid, in a thread separate
from that of the commands. In lockstep, each command leads to the next state.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.messages import message_layout
from parallel_robot_model.common.errors import DRIVEN_OUT, RunError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.compiler import Struct, entry_point, need_compiler
from parallel_robot_model.configuration.hazard_table import Reception
from parallel_robot_model.configuration.loop import WAIT, LoopParameters
from parallel_robot_model.messages import layouts
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_sim.configuration import Configuration, assemble_plant
from parallel_robot_sim.hazards import no_command_yet
from parallel_robot_sim.plant import PlantState
from parallel_robot_sim.plant_core import (
    PlantCore,
    advance,
    read_command,
    state_layout,
    write_state,
)

# The plant as an object: the true robot of a configuration, advanced command by command.


class Simulator:
    """The true robot, its friction, its motors and its state."""

    def __init__(self, configuration: Configuration) -> None:
        """Put the robot at rest at its initial pose.

        Raises:
            InputError: the robot does not reach that pose, or the compiler is switched off.
        """
        need_compiler()
        loop = configuration.loop
        self.robot = robot = configuration.true_robot
        axes = robot.module.coordinates(robot.parameters)
        self._units = ', '.join(axis.unit for axis in axes)
        self._setup, start, self._hazards, _ = assemble_plant(configuration)
        self._period = loop.period
        self._timeout_samples = self._setup.timeout_samples
        n = len(loop.joints)
        self._state, self._waiting = Struct(start), Struct(no_command_yet(n))
        measure = robot.module.measure
        self._measure = entry_point(measure, robot.constants, start.coordinates, start.rate)
        passive = (
            len(self.measurement().passive_position) if configuration.plant.publish_passive else 0
        )
        draft = state_layout(loop.joints, passive).draft()
        self._message = draft.bytes
        self._core = Struct(
            PlantCore(
                self._setup,
                loop.period,
                self._state,
                self._waiting,
                start.torque,
                self._message[4:12].view(np.int32),
                *(draft.fields[name] for name in ('position', 'velocity', 'effort')),
            )
        )
        self._wire = message_layout(layouts.float64_multi_array(n), ('data',), range(n))
        self._read = entry_point(read_command, self._wire, b'', np.zeros(n))
        self._advance = entry_point(advance, self._core, np.zeros(n), True)
        self._write_state = entry_point(write_state, self._core, 0)

    @property
    def state(self) -> PlantState:
        """The present state."""
        state: PlantState = self._state.value
        return state

    @property
    def pose(self) -> np.ndarray:
        """The present pose, shape (m,)."""
        return self.measurement().pose

    def warm(self) -> None:
        """Compile the kernels; the robot advances by one period without torque."""
        self.advance(np.zeros(len(self._core.demand)))

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
        return round(self._state.time / self._period)

    @property
    def reception(self) -> Reception:
        """What hazards leave of the present state."""
        return self._hazards.reception(self.sample)

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
        return bool(self._waiting.missed == self._timeout_samples)

    def _step(self, command: np.ndarray, arrived: bool) -> bool:
        """Advance the state; False, with the state unchanged, if the robot was driven out."""
        inside: bool = self._advance(self._core, command, arrived)
        return inside

    def measurement(self) -> Measurement:
        """Joints and pose at the present state."""
        state = self._state
        joints: Measurement = self._measure(self._setup.robot, state.coordinates, state.rate)
        return joints

    def message(self, stamp: int) -> bytes:
        """The state as a sensor_msgs/JointState; `stamp` in nanoseconds.

        Raises:
            RunError: the robot was driven out of its workspace.
        """
        stamp -= int(self.reception.late) * round(self._period * NANOSECONDS)
        if not self._write_state(self._core, stamp):
            raise RunError(DRIVEN_OUT)
        return self._message.tobytes()


ANNOUNCED = NANOSECONDS // 10  # ns, for which the held pose is published before a common start
REPEAT = NANOSECONDS // 2  # ns, after which a state without an answer is repeated (lockstep)
ENDLESS = -1  # number of steps that are still allowed: unlimited


class PlantRun:
    """Decides what the plant does at each tick, command and request, and which state to publish.

    State k is published; the torque computed from it acts from k to k + 1. The robot is held at
    its initial pose until the common start, or else until the first command. A method that
    returns a bool tells whether there is a state to publish, except for `reset`.
    """

    def __init__(
        self,
        make: Callable[[], Simulator],
        loop: LoopParameters,
        on_time_out: Callable[[], None],
        on_driven_out: Callable[[], None],
    ) -> None:
        """Hold the robot at its initial pose.

        Args:
            make: Returns a new robot at its initial pose.
            loop: Period, start, end and time mode.
            on_time_out: Called when the motors take their safe action because no command comes.
            on_driven_out: Called when the robot has left its workspace.
        """
        self._make = make
        self._loop = loop
        self._on_time_out = on_time_out
        self._on_driven_out = on_driven_out
        self._lockstep, self._period, self._last_index = (
            loop.lockstep,
            loop.period_ns,
            loop.last_index,
        )
        self._start = max(0, loop.start_stamp)  # ns; 0 while it is not known
        self._by_command = loop.start_stamp == 0  # whether the first command starts the motion
        self._reset_requested = False
        self._steps_left = ENDLESS  # in lockstep; 0: paused
        self._was_ready = False  # whether all partners were present at an earlier poll
        self._was_reset = False  # whether the motion begins again (lockstep)
        self.simulator = make()  # the robot
        # index of the last state to publish; None while the robot is held
        self.index: int | None = None
        self.stamp = 0  # its stamp [ns]
        self.message = b''  # its sensor_msgs/JointState
        # the last command [N m], shape (n,)
        self.command: NDArray[np.float64] = np.zeros(len(loop.joints))
        self.commanded = False  # whether a command came since the last state
        self.skipped = 0  # steps without a command in time (wall time)
        self.outside = ''  # how the robot left its workspace; empty while it is inside

    @property
    def finished(self) -> bool:
        """Whether the last state of the motion was published."""
        return self._last_index is not None and (self.index or 0) >= self._last_index

    def describe(self) -> str:
        """How the run goes on (lockstep), for people."""
        left = {0: 'paused', ENDLESS: 'running'}
        steps = left.get(self._steps_left, f'{self._steps_left} steps to go')
        return f'{steps} at state {self.index or 0}'

    def tick(self, stamp: int) -> bool:
        """Advance to the state of a stamp [ns] (wall time)."""
        if self._reset_requested:
            self._recreate()
        if self.outside or self.finished:
            return False
        if self.index is not None:
            return self._step(stamp)
        if self._start == stamp:
            self.index = 0
        elif self._by_command and self.commanded:
            self._start, self.index = stamp - self._period, 0
            return self._step(stamp)
        elif not (self._by_command or self._is_announced(stamp)):
            return False
        self._show(stamp)
        return True

    def start(self, stamp: int) -> bool:
        """Take the common start, the stamp of state 0 [ns]; in wall time, its tick will come."""
        self._start = stamp
        if self._lockstep:
            self.index = 0
            self._show(stamp)
        return self._lockstep

    def take_command(self, torque: NDArray[np.float64]) -> bool:
        """Take a command [N m], shape (n,), of finite numbers; in lockstep, go on with it.

        The array is not copied: it may be reused for the next command.
        """
        self.command = torque
        self.commanded = True
        return self._lockstep and self._steps_left != 0 and self._step_on()

    def poll(self, ready: bool, unanswered: int) -> bool:
        """Start a motion that has no common start or was reset, and repeat states (lockstep).

        Partners may join at any time: a state without an answer is repeated for them. After a
        common start they are all there, and a repetition would stand in the bag.

        Args:
            ready: Whether all partners are present.
            unanswered: Time since the last state was published [ns].
        """
        if (self._loop.start_stamp != 0 and not self._was_reset) or not ready or self.finished:
            return False
        if self.outside or not self._steps_left or unanswered < REPEAT:
            return False
        if not self._was_ready:  # the partners may not have found each other yet
            self._was_ready = True
            return False
        if self.index is None:
            self._start, self.index = self._start or self._loop.step_start, 0
            self._was_reset = False
        self._show(self._start + self.index * self._period)
        return True

    def is_stalled(self, seconds: float) -> bool:
        """Whether the command that lets the motion go on is missing (lockstep).

        Args:
            seconds: Time since the last state was published for the first time [s].
        """
        waits = self.index is not None and not (self.finished or self.outside)
        return waits and self._steps_left != 0 and seconds >= REPEAT / NANOSECONDS

    def step_unanswered(self) -> bool:
        """Step on from a state that hazards leave without an answer (lockstep)."""
        alone = self._lockstep and not self.simulator.reception.answered
        return alone and self._steps_left != 0 and self._step_on()

    def pause(self) -> None:
        """Take no further step (lockstep)."""
        self._steps_left = 0

    def resume(self, steps: int = ENDLESS) -> bool:
        """Go on for some steps (lockstep); a command that came during a pause acts now."""
        paused, self._steps_left = not self._steps_left, steps
        return paused and self.commanded and self._step_on()

    def reset(self) -> bool:
        """Put the robot back to its initial pose: now in lockstep, else with the next tick.

        In lockstep, the motion begins again once commands that are on their way have come.

        Returns:
            Whether that is possible: not before a common start.
        """
        if not self._lockstep:
            self._reset_requested = self._by_command = True
        elif self._loop.start_stamp == WAIT and not self._start:
            return False
        else:
            self._recreate()
            self._was_reset = True
        return True

    def _recreate(self) -> None:
        self.simulator, self.index, self.outside = self._make(), None, ''
        self._reset_requested = self.commanded = False

    def _is_announced(self, stamp: int) -> bool:
        """Whether the held pose is published at a stamp [ns], while a common start is awaited."""
        return self._loop.start_stamp != WAIT or 0 <= self._start - stamp <= ANNOUNCED

    def _step_on(self) -> bool:
        """Step to the next state, if there is one (lockstep)."""
        if self.index is None or self.finished or self.outside:
            return False
        self._steps_left -= self._steps_left > 0
        return self._step(self._start + (self.index + 1) * self._period)

    def _step(self, stamp: int) -> bool:
        """Advance to a stamp [ns], with the command that came, or as the motors do without one."""
        try:
            self.skipped += not self.commanded
            if self.simulator.advance(self.command, self.commanded):
                self._on_time_out()
            self._show(stamp)
        except RunError as error:
            self.outside = str(error)
            self._on_driven_out()
            return False
        self.index = (self.index or 0) + 1
        return True

    def _show(self, stamp: int) -> None:
        """Make the message of the state for a stamp [ns], and await the next command."""
        self.commanded = False
        self.stamp, self.message = stamp, self.simulator.message(stamp)
