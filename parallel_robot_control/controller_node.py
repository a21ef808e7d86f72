"""Node that computes the effort command of every joint state from the newest reference."""

from __future__ import annotations

import sys

import numpy as np
from rclpy.duration import Duration

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.controller import (
    Controller,
    ControllerParameters,
    Sample,
)
from parallel_robot_control.laws import LAWS
from parallel_robot_control.messages import telemetry_messages
from parallel_robot_interface import cdr, topics
from parallel_robot_interface.loop import WAIT
from parallel_robot_interface.ros_joints import JointReader
from parallel_robot_interface.ros_node import SuiteNode, run_node
from parallel_robot_model.parameters import RobotParameters

LAST_WORD = Duration(seconds=1)  # how long the node waits until its zero torque has arrived


class ControllerNode(SuiteNode):
    """Answers each state with one command; what the controller thinks goes out more slowly."""

    def __init__(self) -> None:
        """Prepare the law, then listen."""
        groups = {'robot': RobotParameters, 'controller': ControllerParameters}
        super().__init__('controller', groups | {name: law.Gains for name, law in LAWS.items()})
        self._controller = Controller(self.values)
        self.counts = self._controller.counts
        for warning in self._controller.law.warnings:
            self.get_logger().warning(warning)
        joints = self.loop.joints
        self._state_reader = JointReader(
            topics.JOINT_STATES, joints, ('position', 'velocity'), self.counts
        )
        self._reference_reader = JointReader(
            topics.REFERENCE, joints, ('position', 'velocity', 'acceleration'), self.counts
        )
        self._layout = cdr.float64_multi_array(len(joints))
        self._stamp = 0
        self._from = 0 if self.loop.start_stamp != WAIT else None  # ns; None: not yet
        self._commands = self.publisher(topics.COMMANDS)
        self._telemetry = {
            topic: self.publisher(topic, essential=False)
            for topic in (
                topics.ERROR,
                topics.SYNCHRONISATION_ERROR,
                topics.CROSS_COUPLING_ERROR,
                topics.SLIDING_VARIABLE,
            )
        }
        law = self.publisher(topics.ACTIVE_LAW, essential=False)
        law.publish(cdr.text_message(self._controller.law.name))
        self.subscribe(topics.REFERENCE, self._on_reference)
        self.subscribe(topics.JOINT_STATES, self._on_state)

    def set_start(self, stamp: int) -> None:
        """Answer no state from before the common start [ns]."""
        self._from = stamp

    def close(self) -> None:
        """Leave the robot without torque: the last message is zero."""
        self._commands.publish(self._layout.encode(data=np.zeros(len(self.loop.joints))))
        self._commands.wait_for_all_acked(LAST_WORD)

    def _on_reference(self, data: bytes) -> None:
        message = self._reference_reader.read(data)
        if message is not None:
            stamp, vectors = message
            self._publish(self._controller.add_reference(stamp, JointReference(*vectors)))

    def _on_state(self, data: bytes) -> None:
        message = self._state_reader.read(data)
        if message is not None and self._from is not None and message[0] >= self._from:
            self._stamp, vectors = message
            self._publish(self._controller.add_state(self._stamp, Feedback(*vectors)))

    def _publish(self, sample: Sample | None) -> None:
        if sample is None:
            return
        self._commands.publish(self._layout.encode(data=sample.torque))
        if self._stamp // self.loop.period_ns % topics.SLOW == 0:
            stamps = np.array([self._stamp])
            messages = telemetry_messages(self.loop.joints, stamps, sample.telemetry)
            for topic, records in messages.items():
                self._telemetry[topic].publish(records.tobytes())


def main() -> int:
    """Run the node."""
    return run_node(ControllerNode)


if __name__ == '__main__':
    sys.exit(main())
