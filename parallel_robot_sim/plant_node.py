"""Node that simulates the robot: effort commands in, joint states out.

The robot is held at its initial pose by its brake until the common `start_stamp`, or else until
the first command. State k is published; the torque computed from it acts from k to k + 1. A robot
that is driven out of its workspace is held and silent until ``~/reset``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from parallel_robot_base import cdr, realtime, topics
from parallel_robot_base.errors import InputError, RunError
from parallel_robot_base.loop import STEP_START, WAIT
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_ros.suite_node import SuiteNode, run_node
from parallel_robot_sim.ros_markers import RobotMarkers
from parallel_robot_sim.simulator import GROUPS, Simulator
from trajectory_gen.messages import pose_fields

HELD = NANOSECONDS // 10  # ns, for which the held pose is published before a common start
REPEAT = 0.5  # s, between two publications of a state that nobody answers (lockstep by hand)
ENDLESS = -1  # steps that are still allowed: no end


class PlantNode(SuiteNode):
    """Publishes ``joint_states`` every period, or in lockstep after every command."""

    priority = realtime.LOOP

    def __init__(self) -> None:
        """Put the robot at its initial pose and begin to publish."""
        super().__init__('plant', GROUPS)
        self._simulator = Simulator(self.values)
        self._start = max(0, self.loop.start_stamp)  # ns; 0 while it is not known
        self._index: int | None = None  # of the last published state; None while held
        self._command = np.zeros(3)
        self._commanded = False  # whether a command came since the last state
        self._reset_requested = False
        self._by_command = self.loop.start_stamp == 0  # how the motion starts
        self._outside = ''  # how the robot left its workspace
        self._steps_left = ENDLESS  # in lockstep; 0: paused
        self._published = 0  # states
        self._published_at = 0  # ns, monotonic
        self._complete = False  # whether nothing was missing at a look before (lockstep by hand)
        self._round_trips: list[int] = []  # ns
        self._delays: list[int] = []  # ns, publication after its stamp (wall time)
        self._skipped = 0  # states without a command in time (wall time)
        self._states = self.publisher(topics.JOINT_STATES)
        self._poses = self.publisher(topics.POSE, essential=False)
        self._pose_message = cdr.pose_stamped(topics.FRAME).draft()
        self._markers = self.publisher(topics.MARKERS, essential=False)
        self._marker_builder = RobotMarkers(self._simulator.robot)
        self.subscribe(topics.COMMANDS, self._on_command, complete=False)
        self.create_service(Trigger, '~/reset', self._answer_reset)
        self._simulator.warm()
        self._simulator = Simulator(self.values)
        if self.lockstep:
            self._time = self.publisher(topics.CLOCK, essential=False)
            self._time_message = cdr.clock().draft()
            self.create_timer(REPEAT, self._begin_lockstep)
            for name, answer in (
                ('pause', self._answer_pause),
                ('resume', self._answer_resume),
                ('step', self._answer_step),
            ):
                self.create_service(Trigger, f'~/{name}', answer)
        else:
            self.keep_time(self._tick)

    def is_settable(self, key: str) -> bool:
        """How many samples ``~/step`` takes."""
        return super().is_settable(key) or key == 'plant.steps'

    def judge(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Take a new number of steps; all else is fixed or the common start."""
        if set(changes) != {'plant.steps'}:
            return super().judge(changes)
        steps = changes['plant.steps']
        if type(steps) is not int or steps < 1:
            raise InputError(f'plant.steps must be a whole number from 1 on, not {steps!r}')
        self.values = {**self.values, **changes}
        return changes, lambda: None

    def set_start(self, stamp: int) -> None:
        """Release the brake with the state of `stamp` [ns]."""
        self._start = stamp
        if self.lockstep:
            self._index = 0
            self._publish(stamp)

    def alarm(self) -> str:
        """How the robot left its workspace."""
        return f'{self._outside}; ~/reset puts it back' if self._outside else ''

    def diagnose(self) -> dict[str, str]:
        """Delays of the publications and round trips of the last second."""
        figures = {}
        for name, values in (('delay', self._delays), ('round trip', self._round_trips)):
            if values:
                p50, p99, largest = 1e-6 * np.percentile(values, [50, 99, 100])
                figures[f'{name} p50/p99/max [ms]'] = f'{p50:.3f}/{p99:.3f}/{largest:.3f}'
                values.clear()
        if not self.lockstep:
            figures['states without a command in time'] = str(self._skipped)
        figures['state'] = 'held' if self._index is None else str(self._index)
        return figures

    def handled(self) -> int:
        """States published."""
        return self._published

    def _tick(self, stamp: int) -> None:
        """Publish the state of one stamp (wall time)."""
        if self._reset_requested:
            self._put_back()
        if self._outside:
            return
        if self._index is None:
            waits = self.loop.start_stamp == WAIT and not self._by_command
            if waits and not 0 <= self._start - stamp <= HELD:
                return  # nobody asked yet
            if self._start == stamp:
                self._index = 0
            elif self._by_command and self._commanded:
                self._start, self._index = stamp - self.period_ns, 0
                self._step()
        elif self._finished():
            return
        else:
            self._step()
        if not self._outside:
            self._publish(stamp)
            self._delays.append(time.time_ns() - stamp)

    def _begin_lockstep(self) -> None:
        """Publish the first state once somebody can answer, and one that nobody answered again."""
        if self.loop.start_stamp != 0 or self.missing() or self._finished():
            return
        if self._outside or not self._steps_left:
            return
        if not self._complete:  # subscribers may not know yet whom they hear
            self._complete = True
            return
        if self._index is None:
            self._start, self._index = STEP_START, 0
        elif time.monotonic_ns() - self._published_at < REPEAT * NANOSECONDS:
            return
        self._publish(self._stamp)

    @property
    def _stamp(self) -> int:
        """Of the last published state [ns]."""
        return self._start + (self._index or 0) * self.period_ns

    def _on_command(self, data: bytes) -> None:
        if not (self._simulator.read(data, self._command) or self._read(data)):
            return
        if not self._commanded:
            self._round_trips.append(time.monotonic_ns() - self._published_at)
        self._commanded = True
        if self.lockstep and self._steps_left and self._index is not None:
            self._go_on()

    def _go_on(self) -> None:
        """Step to the next state and publish it (lockstep)."""
        if self._finished() or self._outside:
            return
        self._steps_left -= self._steps_left > 0
        self._step()
        if not self._outside:
            self._publish(self._stamp)

    def _read(self, data: bytes) -> bool:
        """Read a command of another layout; False, counted, when it is not one."""
        command = cdr.read_numbers(data)
        if command.shape != (3,) or not np.isfinite(command).all():
            self.counts['commands that are not three finite torques'] += 1
            return False
        self._command[:] = command
        return True

    def _step(self) -> None:
        try:
            if self._commanded or self.lockstep:
                self._simulator.advance(self._command)
            else:
                self._skipped += 1
                if self._simulator.wait(self._command):
                    self.counts['command time-outs'] += 1
                    self.get_logger().warning('no commands: the motors take their safe action')
        except RunError as error:
            self._outside = str(error)
            self.get_logger().error(self.alarm())
            return
        self._index = (self._index or 0) + 1

    def _finished(self) -> bool:
        return self.samples is not None and (self._index or 0) >= self.samples

    def _publish(self, stamp: int) -> None:
        if self.lockstep:
            self._time.publish(self._time_message.encode(stamp))
        self._commanded = False
        message = self._simulator.message(stamp)
        self._published_at = time.monotonic_ns()
        self._states.publish(message)
        self._published += 1
        index = stamp // self.period_ns
        if index % topics.SLOW == 0:
            pose = self._simulator.pose
            fields = pose_fields(pose[np.newaxis])
            self._poses.publish(self._pose_message.encode(stamp, **fields))
            if index % topics.MARKERS_EVERY == 0 and self._markers.get_subscription_count():
                self._markers.publish(self._marker_builder.build(stamp, pose))

    def _put_back(self) -> None:
        """Hold the robot at its initial pose."""
        self._simulator, self._index, self._outside = Simulator(self.values), None, ''
        self._reset_requested = self._commanded = False

    def _answer_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = not self.lockstep or self.loop.start_stamp == 0
        if not response.success:
            response.message = 'not in lockstep with a common start: others would not begin again'
        elif self.lockstep:
            self._put_back()
            response.message = 'the motion begins again'
            self._begin_lockstep()
        else:
            self._reset_requested = self._by_command = True
            response.message = 'held at the initial pose until the next command'
        return response

    def _answer_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._steps_left = 0
        return self._answered(response)

    def _answer_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._resume(ENDLESS)
        return self._answered(response)

    def _answer_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._resume(int(self.values['plant.steps']))
        return self._answered(response)

    def _resume(self, steps: int) -> None:
        """Go on for some steps; a command that came during a pause is acted on now."""
        paused, self._steps_left = not self._steps_left, steps
        if paused and self._commanded and self._index is not None:
            self._go_on()

    def _answered(self, response: Trigger.Response) -> Trigger.Response:
        response.success = not self._outside
        left = {0: 'paused', ENDLESS: 'running'}.get(
            self._steps_left, f'{self._steps_left} steps to go'
        )
        response.message = self.alarm() or f'{left} at state {self._index or 0}'
        return response


def main() -> int:
    """Run the node."""
    return run_node(PlantNode)


if __name__ == '__main__':
    sys.exit(main())
