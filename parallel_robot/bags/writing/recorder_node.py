"""Node that records to a bag: the suite's topics, or any others."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from rclpy.subscription import Subscription

from parallel_robot.bags import output
from parallel_robot.bags.writing.recorder import Recorder
from parallel_robot.bags.writing.ros_topics import (
    Discovery,
    ParameterWatch,
    RecorderParameters,
    full_name,
    listen_all,
)
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import WAIT
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.processes import realtime
from parallel_robot_model.robots.registry import robot_of

CHECK = 0.05  # s, how often to check whether the motion is over
LOOK = 0.5  # s, how often to look at the ROS graph


class RecorderNode(SuiteNode):
    """Records from its own or the common start to the end of the motion or of the node."""

    priority = realtime.LISTENER
    example = '--ros-args -p recorder.out:=my_bag'

    def __init__(self) -> None:
        """Subscribe to everything; without a common start, begin at once."""
        super().__init__('recorder', resolve)
        self.declare_groups(('recorder', RecorderParameters))
        wanted = group(self.values, RecorderParameters, 'recorder')
        directory = Path(wanted.out or time.strftime('recording_%Y%m%d_%H%M%S'))
        output.check_directory(directory, 'recorder.out')
        choosing = bool(wanted.topics or wanted.regex or wanted.all)
        placed = robot_of(self.values).place > 0
        suite = () if choosing else topics.recorded(placed)
        self._recorder = Recorder(directory, self.loop, self.values, self.fail, suite)
        self._topics: dict[topics.Topic, Subscription] = {}
        self._discovery = Discovery(self, wanted) if choosing else None
        for topic in suite:
            self._topics[topic] = listen_all(self, topic, None, self._recorder.taker(topic))
        self._parameter_watch = ParameterWatch(self, self._found, self._recorder.changed)
        self.create_timer(LOOK, self._look)
        self.create_timer(CHECK, self._check)
        self._waiting = True
        if self.loop.start_stamp != WAIT:
            self._recorder.open(self.loop.start_stamp)
            self.get_logger().info(f'recording to {directory}')

    def missing(self) -> str:
        """What the recorder still waits for: topics that nobody publishes yet, parameters."""
        silent = [
            topic.name
            for topic, subscription in self._topics.items()
            if not subscription.get_publisher_count()
        ]
        if silent:
            return f'no publisher of {", ".join(silent)}'
        self._ask()
        silent = self._parameter_watch.missing()
        return f'no parameters of {", ".join(silent)}' if silent else ''

    def diagnose(self) -> dict[str, Any]:
        """Messages by topic, and how many are known to be missing."""
        received = {topic.name: count for topic, count in self._recorder.received.items()}
        return received | {'lost': self._recorder.losses}

    def handled(self) -> int:
        """States recorded; where others were chosen, messages of any topic."""
        received = self._recorder.received
        return received[topics.JOINT_STATES] or received.total()

    def set_start(self, stamp: int) -> None:
        """Record from `stamp` [ns] on."""
        self._recorder.open(stamp)

    def close(self) -> None:
        """Complete the bag and report; an end before that of the motion is a failure."""
        ends = self.last_index is not None and self.loop.start_stamp == WAIT
        if ends and self.exit_code is None and not self._recorder.complete():
            self.get_logger().fatal('stopped before the end of the motion')
            self.finish(1)
        for line in self._recorder.close():
            self.get_logger().info(line)

    def _look(self) -> None:
        """Record new topics, ask their nodes, and see which topics have several publishers."""
        for topic, (channel, qos) in (self._discovery.new() if self._discovery else {}).items():
            self._recorder.add(topic, channel)
            self._topics[topic] = listen_all(self, topic, qos, self._recorder.taker(topic))
        for topic, subscription in self._topics.items():
            if subscription.get_publisher_count() > 1:
                self._recorder.several(topic)
        self._ask()

    def _found(self, node: str, parameters: dict[str, Any]) -> None:
        for trouble in self._recorder.found(node, parameters):
            self.get_logger().warning(f'{node}: {trouble}; the bag does not hold this law')

    def _ask(self) -> None:
        """Ask all publishers for their parameters."""
        self._parameter_watch.ask(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for topic in self._topics
            for info in self.get_publishers_info_by_topic(full_name(topic))
        )

    def _check(self) -> None:
        if self._waiting and not self.missing():
            self._waiting = False
            self.get_logger().info('ready: every topic has a publisher')
        if self._recorder.complete():
            self.finish()


def main() -> int:
    """Run the node."""
    return run_node(RecorderNode)


if __name__ == '__main__':
    sys.exit(main())
