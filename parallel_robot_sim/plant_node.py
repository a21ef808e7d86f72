"""Node that simulates the robot: effort commands in, joint states out.

The robot is held at its initial pose by its brake until the common `start_stamp`, or else until
the first command. State k is published; the torque computed from it acts from k to k + 1.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from parallel_robot_interface import cdr, realtime, topics
from parallel_robot_interface.cdr import NANOSECONDS
from parallel_robot_interface.loop import STEP_START, WAIT
from parallel_robot_interface.ros_node import SuiteNode, run_node
from parallel_robot_sim.ros_markers import RobotMarkers
from parallel_robot_sim.simulator import GROUPS, Simulator
from trajectory_gen.messages import pose_messages

HELD = NANOSECONDS // 10  # ns, for which the held pose is published before a common start
REPEAT = 0.5  # s, between two publications of a state that nobody answers (lockstep by hand)


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
        self._published_at = 0  # ns, monotonic
        self._complete = False  # whether nothing was missing at a look before (lockstep by hand)
        self._round_trips: list[float] = []  # ms
        self._delays: list[float] = []  # ms, publication after its stamp (wall time)
        self._commands = cdr.float64_multi_array(3)
        self._states = self.publisher(topics.JOINT_STATES)
        self._poses = self.publisher(topics.POSE, essential=False)
        self._markers = self.publisher(topics.MARKERS, essential=False)
        self._marker_builder = RobotMarkers(self._simulator.robot)
        self.subscribe(topics.COMMANDS, self._on_command, complete=False)
        self.create_service(Trigger, '~/reset', self._answer_reset)
        self._simulator.message(0)  # compiles what the loop will need
        self._simulator.wait(np.zeros(3))
        self._simulator = Simulator(self.values)
        if self.loop.lockstep:
            self._time = self.publisher(topics.CLOCK, essential=False)
            self._time_layout = cdr.clock()
            self.create_timer(REPEAT, self._begin_lockstep)
        else:
            self.keep_time(self._tick)

    def set_start(self, stamp: int) -> None:
        """Release the brake with the state of `stamp` [ns]."""
        self._start = stamp
        if self.loop.lockstep:
            self._index = 0
            self._publish(stamp)

    def diagnose(self) -> dict[str, str]:
        """Delays of the publications and round trips of the last second."""
        figures = {}
        for name, values in (('delay', self._delays), ('round trip', self._round_trips)):
            if values:
                p50, p99, largest = np.percentile(values, [50, 99, 100])
                figures[f'{name} p50/p99/max [ms]'] = f'{p50:.3f}/{p99:.3f}/{largest:.3f}'
                values.clear()
        figures['state'] = 'held' if self._index is None else str(self._index)
        return figures

    def _tick(self, stamp: int) -> None:
        """Publish the state of one stamp (wall time)."""
        if self._reset_requested:
            self._simulator, self._index = Simulator(self.values), None
            self._reset_requested = self._commanded = False
        if self._index is None:
            if self.loop.start_stamp == WAIT and not 0 <= self._start - stamp <= HELD:
                return  # nobody asked yet
            if self._start == stamp:
                self._index = 0
            elif self.loop.start_stamp == 0 and self._commanded:
                self._start, self._index = stamp - self.loop.period_ns, 0
                self._step()
        elif self._finished():
            return
        else:
            self._step()
        self._publish(stamp)
        self._delays.append((time.time_ns() - stamp) * 1e-6)

    def _begin_lockstep(self) -> None:
        """Publish the first state once somebody can answer, and any that nobody did again."""
        if self.loop.start_stamp != 0 or self.missing() or self._finished():
            return
        if not self._complete:  # subscribers may not know yet whom they hear
            self._complete = True
            return
        if self._index is None:
            self._start, self._index = STEP_START, 0
        elif time.monotonic_ns() - self._published_at < REPEAT * NANOSECONDS:
            return
        self._publish(self._start + self._index * self.loop.period_ns)

    def _on_command(self, data: bytes) -> None:
        command = self._read(data)
        if command is None:
            return
        if not self._commanded:
            self._round_trips.append((time.monotonic_ns() - self._published_at) * 1e-6)
        self._command, self._commanded = command, True
        if not self.loop.lockstep:
            return
        if self._index is None or self._finished():
            return
        self._step()
        self._publish(self._start + self._index * self.loop.period_ns)

    def _read(self, data: bytes) -> np.ndarray | None:
        """Torques [N m], shape (3,), of a command; None, counted, when it is not one."""
        records = self._commands.decode(data)
        if records is not None:
            command = np.array(records['data'][0])
        else:
            try:
                command = np.array(deserialize_message(data, Float64MultiArray).data)
            except Exception:  # rmw raises a bare RuntimeError or MemoryError on broken bytes
                command = np.empty(0)
        if command.shape != (3,) or not np.isfinite(command).all():
            self.counts['commands that are not three finite torques'] += 1
            return None
        return command

    def _step(self) -> None:
        if self._commanded or self.loop.lockstep:
            self._simulator.advance(self._command)
        elif self._simulator.wait(self._command):
            self.counts['command time-outs'] += 1
            self.get_logger().warning('no commands: the motors take their safe action')
        self._index = (self._index or 0) + 1

    def _finished(self) -> bool:
        return self.loop.samples is not None and (self._index or 0) >= self.loop.samples

    def _publish(self, stamp: int) -> None:
        if self.loop.lockstep:
            self._time.publish(self._time_layout.encode(stamp))
        self._commanded = False
        self._published_at = time.monotonic_ns()
        self._states.publish(self._simulator.message(stamp))
        index = stamp // self.loop.period_ns
        pose = self._simulator.state.pose
        if index % topics.SLOW == 0:
            self._poses.publish(pose_messages(stamp, pose[np.newaxis]).tobytes())
        if index % topics.MARKERS_EVERY == 0 and self._markers.get_subscription_count():
            self._markers.publish(self._marker_builder.build(stamp, pose))

    def _answer_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.loop.start_stamp == 0 and not self.loop.lockstep
        self._reset_requested = response.success
        response.message = (
            'held at the initial pose until the next command'
            if response.success
            else 'only in wall time without a common start'
        )
        return response


def main() -> int:
    """Run the node."""
    return run_node(PlantNode)


if __name__ == '__main__':
    sys.exit(main())
