"""Node that publishes figures of merit of the motion that it sees."""

from __future__ import annotations

import sys

from std_msgs.msg import Float64

from parallel_robot_analysis.monitor import Figures, Monitor, MonitorParameters
from parallel_robot_base import topics
from parallel_robot_base.topics import Topic
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_ros.joint_reader import JointReader
from parallel_robot_ros.suite_node import SuiteNode, run_node


class MonitorNode(SuiteNode):
    """Publishes each figure on a topic of its own, ten times in a second of motion."""

    example = '--ros-args -p monitor.window:=2.0'

    def __init__(self) -> None:
        """Prepare to publish, then listen."""
        super().__init__('monitor', {'robot': RobotParameters, 'monitor': MonitorParameters})
        self._monitor = Monitor(self.values)
        joints = self.loop.joints
        self._state_reader = JointReader(
            topics.JOINT_STATES, joints, ('position', 'effort'), self.counts
        )
        self._reference_reader = JointReader(
            topics.REFERENCE, joints, ('position', 'velocity', 'acceleration'), self.counts
        )
        self._figures = [
            self.publisher(Topic(f'monitor/{name}', 'std_msgs/msg/Float64', 0), essential=False)
            for name in Figures._fields
        ]
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
        figures = self._monitor.add_state(stamp, position, effort)
        for publisher, value in zip(self._figures, figures or (), strict=False):
            publisher.publish(Float64(data=value))


def main() -> int:
    """Run the node."""
    return run_node(MonitorNode)


if __name__ == '__main__':
    sys.exit(main())
