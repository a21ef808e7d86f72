"""What the processes of the empty twin share: constant messages, topics, diagnostics."""

from __future__ import annotations

import argparse
from collections import Counter
from typing import Any

import checkout  # noqa: F401
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from parallel_robot_control.messages import telemetry_layouts
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_model.processes.realtime import DeadlineThread

PERIOD = 1_000_000  # ns
JOINTS = ('joint1', 'joint2', 'joint3')
STATUS = {
    'law': 's_fotsmc',
    'fault': 'none',
    'fault code': 'none',
    'limits that acted': 'none',
    'limit codes': '',
}
MESSAGES = {
    topics.JOINT_STATES: layouts.joint_state((*JOINTS, *(f'{name}_passive' for name in JOINTS))),
    topics.REFERENCE: layouts.joint_trajectory(JOINTS),
    topics.COMMANDS: layouts.float64_multi_array(len(JOINTS)),
    topics.POSE: layouts.pose_stamped(topics.FRAME),
    topics.POSE_REFERENCE: layouts.pose_stamped(topics.FRAME),
    topics.ANSWERED: layouts.int64_multi_array((3 + len(JOINTS)) * topics.SLOW),
    **telemetry_layouts(JOINTS),
    topics.STATUS: layouts.diagnostic_array(
        'controller: status', 0, 'ok', STATUS, frame=topics.FRAME
    ),
    topics.CLOCK: layouts.clock(),
}
BYTES = {topic: layouts.padded(layout.template.tobytes()) for topic, layout in MESSAGES.items()}
BYTES[topics.ACTIVE_LAW] = layouts.text_message('s_fotsmc')
TELEMETRY = tuple(topic for topic in topics.RECORDED if topic.name.startswith('controller/'))


class EmptyNode(Node):  # type: ignore[misc]
    """A node of the twin."""

    def __init__(self, name: str, arguments: argparse.Namespace) -> None:
        super().__init__(name)
        self.lockstep = arguments.lockstep
        self.samples = arguments.samples
        self.published: Counter[str] = Counter()
        self.start_stamp = 0
        self._wanted = arguments.subscribers
        self._publishers_by_topic: dict[Topic, Any] = {}
        self._thread: DeadlineThread | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._publish_diagnostics)

    def offer(self, *names: Topic) -> None:
        """Create publishers as the suite's."""
        for topic in names:
            self._publishers_by_topic[topic] = self.create_publisher(
                message_class(topic.type), topic.name, qos_of(topic)
            )

    def publish(self, topic: Topic) -> None:
        """Publish the constant bytes of a topic."""
        self._publishers_by_topic[topic].publish(BYTES[topic])
        self.published[topic.name] += 1

    def hear(self, topic: Topic, callback: Any) -> None:
        """Subscribe as the suite's loop: in wall time the newest alone, in lockstep all."""
        qos = QoSProfile(depth=topics.QUEUE)
        if not self.lockstep:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        kind = message_class(topic.type)
        self.create_subscription(kind, topic.name, callback, qos, raw=True)

    def matched(self) -> bool:
        """Whether all subscribers and publishers are there."""
        return all(
            publisher.get_subscription_count() >= self._wanted.get(topic.name, 0)
            for topic, publisher in self._publishers_by_topic.items()
        ) and all(subscription.get_publisher_count() for subscription in self.subscriptions)

    def begin(self, stamp: int) -> None:
        """Take the common start [ns]."""
        self.start_stamp = stamp

    def start_timer(self, tick: Any, ahead: int = 0) -> None:
        """Call ``tick(stamp)`` for the stamps of the motion."""

        def within(stamp: int) -> None:
            if 0 <= stamp - self.start_stamp <= self.samples * PERIOD:
                tick(stamp)

        self._thread = DeadlineThread(PERIOD, within, self._fail, ahead)
        self._thread.start()

    def figures(self) -> dict[str, str]:
        """Key figures of the last second."""
        return {}

    def close(self) -> None:
        """Stop."""
        if self._thread is not None:
            self._thread.stop()

    def _fail(self, error: Exception) -> None:
        self.get_logger().fatal(repr(error))

    def _publish_diagnostics(self) -> None:
        values = [KeyValue(key=key, value=value) for key, value in self.figures().items()]
        status = DiagnosticStatus(
            name=f'{self.get_name()}: loop', message='ok', hardware_id=self.get_name()
        )
        status.values = values
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)
