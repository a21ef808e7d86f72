"""Node that publishes the desired motion.

Before the start it publishes the first sample of the motion, at rest. The motion starts at the
common `start_stamp`, or else with the first command of a controller or a call of ``~/start``.
"""

from __future__ import annotations

import sys

import numpy as np
from std_srvs.srv import Trigger

from parallel_robot_base import cdr_reader, realtime, topics
from parallel_robot_base.loop import OLDEST, STEP_START, WAIT
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_ros.life_cycle import run_node
from parallel_robot_ros.suite_node import SuiteNode
from trajectory_gen import preflight
from trajectory_gen.messages import pose_messages, reference_messages
from trajectory_gen.shapes import resolve, shapes_of
from trajectory_gen.trajectory import Trajectory, TrajectoryParameters

BATCH = 200  # samples computed at once


class TrajectoryNode(SuiteNode):
    """Publishes ``reference`` on the grid of the period and ``pose_reference`` more slowly."""

    priority = realtime.LOOP

    def __init__(self) -> None:
        """Check the whole motion, then start to publish."""
        super().__init__('trajectory', resolve)
        self._trajectory = Trajectory(self.values)
        robot = self._trajectory.robot.module
        self.declare_group('robot', robot.Parameters)
        self.declare_group('trajectory', TrajectoryParameters)
        self.declare_group('trajectory', robot.MotionLimits)
        for name, shape in shapes_of(self.values).items():
            self.declare_group(name, shape.Parameters)
        preflight.check(self._trajectory, self.loop.period)
        self._start = max(0, self.loop.start_stamp)  # ns; 0 while it is not known
        self._batch: tuple[int, np.ndarray, np.ndarray] | None = None
        self._start_requested = False
        self._asked = 0  # ns, stamp of the last state (lockstep)
        self._late = 0  # ns, age of the states, as the first one tells it (lockstep)
        self._sent = -1  # index of the last sample of the motion that was published
        self._published = 0  # number of references
        self._reference = self.publisher(topics.REFERENCE)
        self._pose = self.publisher(topics.POSE_REFERENCE, essential=False)
        self.create_service(Trigger, '~/start', self._answer_start)
        if self.lockstep:
            self.subscribe(topics.JOINT_STATES, self._on_state)
            return
        if self.loop.start_stamp == 0:
            self.subscribe(topics.COMMANDS, self._on_command)
        first = self._trajectory.sample(0.0)
        self._rest = first._replace(
            velocity=np.zeros_like(first.velocity), acceleration=np.zeros_like(first.acceleration)
        )
        ahead = round(self._trajectory.parameters.lookahead * NANOSECONDS)
        self.keep_time(self._tick, ahead)

    def set_start(self, stamp: int) -> None:
        """Start the motion with its first sample at `stamp` [ns]."""
        self._start = stamp

    def handled(self) -> int:
        """Number of references published."""
        return self._published

    def _tick(self, stamp: int) -> None:
        """Publish the sample of one stamp (wall time)."""
        if not self._start and self._start_requested:
            self._start = stamp
        if self._start and stamp >= self._start:
            self._publish((stamp - self._start) // self.period_ns)
        elif self.loop.start_stamp == 0:
            rest = reference_messages(self.loop.joints, stamp, self._rest)
            self._reference.publish(rest.tobytes())
            self._published += 1

    def _on_command(self, _: bytes) -> None:
        self._start_requested = True

    def _answer_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = not self._start and self.loop.start_stamp != WAIT
        response.message = 'started' if response.success else 'has started or waits for its stamp'
        self._start_requested = self._start_requested or response.success
        return response

    def _on_state(self, data: bytes) -> None:
        """Keep the reference ahead of the plant (lockstep)."""
        stamp = cdr_reader.header_stamp(data)
        if stamp is None or (self.loop.start_stamp == WAIT and not self._start):
            return
        start = self._start or STEP_START
        if not self._asked or stamp <= self._asked:
            self._late = start - stamp if 0 < start - stamp <= OLDEST else 0
        k = (stamp + self._late - start) // self.period_ns
        if k < 0 or (self.last_index is not None and k > self.last_index):
            self.counts['joint states that are not of this motion'] += 1
            return
        if not self._start or stamp <= self._asked:
            self._sent = k - 1  # a new run, or the plant repeats a state: references are missing
        self._start, self._asked = start, stamp
        if self._sent < k + BATCH // 2:
            for index in range(max(self._sent + 1, k), k + BATCH + 1):
                self._publish(index)

    def _publish(self, k: int) -> None:
        """Publish sample `k` of the motion; nothing after its end."""
        last = self.last_index
        if k <= self._sent or (last is not None and k > last):
            return
        first = k // BATCH * BATCH
        if self._batch is None or self._batch[0] != first:
            indices = np.arange(first, first + BATCH)
            stamps = self._start + indices * self.period_ns
            samples = self._trajectory.sample(indices * self.loop.period)
            references = reference_messages(self.loop.joints, stamps, samples)
            self._batch = (first, references, pose_messages(stamps, samples.pose))
        _, references, poses = self._batch
        self._reference.publish(references[k - first].tobytes())
        self._published += 1
        if k % topics.SLOW == 0 and self._trajectory.robot.module.PLANAR:
            self._pose.publish(poses[k - first].tobytes())
        self._sent = k


def main() -> int:
    """Run the node."""
    return run_node(TrajectoryNode)


if __name__ == '__main__':
    sys.exit(main())
