"""Node that publishes metrics of the motion that it sees, and all joints of the robot."""

from __future__ import annotations

import math
import sys

import numpy as np
from std_msgs.msg import Float64

from parallel_robot.analysis.monitor import Monitor, MonitorParameters, Posture
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.configuration.fields import (
    ESTIMATOR,
    ZeroAngles,
    given_zero_angles,
    group,
)
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.nodes.joint_reader import JointReader
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.processes import realtime
from parallel_robot_model.robots.tree import has_tree
from parallel_robot_sim.motions import differs
from trajectory_gen.configuration import resolve

LINKS = Topic('monitor/joint_states', 'sensor_msgs/msg/JointState', topics.MARKERS_EVERY)


class MonitorNode(SuiteNode):
    """Publishes each metric on a topic of its own, ten times in a second of motion.

    For tools that draw robots it publishes the description, and fifty times in a second of motion
    the joints of all links, with the passive ones that close the chain.
    """

    priority = realtime.LISTENER
    example = '--ros-args -p monitor.window:=2.0'

    def __init__(self) -> None:
        """Prepare to publish, then listen."""
        super().__init__('monitor', resolve)
        robot, guess = nominal_of(self.values)
        self.declare_groups(
            ('robot', robot.module.Parameters),
            ('monitor', MonitorParameters),
            (ESTIMATOR, ZeroAngles),
            units=robot.joint_units,
        )
        self._zero_angle = given_zero_angles(self.values)
        parameters = group(self.values, MonitorParameters, 'monitor')
        self._monitor = Monitor(robot, guess, parameters)
        joints = self.loop.joints
        self._state_reader = JointReader(
            topics.JOINT_STATES, joints, ('position',), self.counts, {'effort': math.nan}
        )
        self._reference_reader = JointReader(
            topics.REFERENCE, joints, ('position', 'velocity', 'acceleration'), self.counts
        )
        self._metrics = {
            name: self.publisher(
                Topic(f'monitor/{name}', 'std_msgs/msg/Float64', 0), essential=False
            )
            for name in self._monitor.names
        }
        self._posture = (
            Posture(robot, guess, self.loop, self._zero_angle) if has_tree(robot) else None
        )
        if self._posture is not None:
            self._layout = layouts.joint_state(self._posture.joints, ('position',))
            self._links = self.publisher(LINKS, essential=False)
            description = self.publisher(topics.ROBOT_DESCRIPTION, essential=False)
            description.publish(layouts.text_message(self._posture.description))
        if differs(self.values):
            self.get_logger().info(
                'metrics, joints and frames are seen: true_robot or sensors differ'
            )
        self.subscribe(topics.REFERENCE, self._on_reference)
        self.subscribe(topics.JOINT_STATES, self._on_state)

    def _on_reference(self, data: bytes) -> None:
        message = self._reference_reader.read(data)
        if message is not None:
            self._monitor.add_reference(*message)

    def _on_state(self, data: bytes) -> None:
        message = self._state_reader.read(data)
        if message is None:
            return
        stamp, (position, effort) = message
        if self._posture is not None:
            angles = self._posture.add_state(stamp, position)
            if angles is not None:
                records = self._layout.records(
                    1, np.array([stamp]), position=angles[self._posture.moving]
                )
                self._links.publish(records[0].tobytes())
        found = self._monitor.add_state(stamp, position - self._zero_angle, effort)
        if found is not None:
            for name, publisher in self._metrics.items():
                publisher.publish(Float64(data=getattr(found, name)))


def main() -> int:
    """Run the node."""
    return run_node(MonitorNode)


if __name__ == '__main__':
    sys.exit(main())
