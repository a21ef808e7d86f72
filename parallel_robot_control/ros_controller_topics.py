"""What a controller publishes: its commands and, less often, its state."""

from __future__ import annotations

import time
from functools import partial

from rclpy.publisher import Publisher

from parallel_robot_control.answer_kernel import LOG, STATUS, TELEMETRY
from parallel_robot_control.controller import Controller
from parallel_robot_control.messages import (
    Status,
    limits_text,
    status_message,
    telemetry_fields,
    telemetry_layouts,
)
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.nodes.suite_node import SuiteNode

LAST_WORD = 0.5  # s, time a publisher stays after zero torque, so that it is received
DISCOVERY_TIME = 1.0  # s, in which subscribers discover a new publisher
SOON = 0.005  # s, between two looks


class NullPublisher:
    """In place of a publisher that is not there."""

    def publish(self, _: bytes) -> None:
        """Send nothing."""


class ControllerTopics:
    """The publishers of a controller node."""

    def __init__(self, node: SuiteNode, controller: Controller, sends: bool = True) -> None:
        """Create the publishers, and publish the name of the active law.

        Args:
            node: The node.
            controller: The controller whose output is published.
            sends: Whether it sends commands from the start; else from `send` on.
        """
        self._node, self._controller = node, controller
        self._status: Status | None = None  # as last published
        self._law = controller.law.name  # as last published
        self._commands: Publisher | NullPublisher = NullPublisher()
        if sends:
            self._commands = node.publisher(topics.COMMANDS)
        self._telemetry = {
            topic: (node.publisher(topic, essential=False), layout.draft())
            for topic, layout in telemetry_layouts(node.loop.joints).items()
        }
        self._log = node.publisher(topics.ANSWERED, essential=False)
        self._active_law = node.publisher(topics.ACTIVE_LAW, essential=False)
        self._active_law.publish(layouts.text_message(self._law))
        self._statuses = node.publisher(topics.STATUS, essential=False)

    def send(self) -> bool:
        """Send commands from now on; returns whether somebody hears them."""
        self._commands = publisher = self._node.publisher(topics.COMMANDS)
        deadline = time.monotonic() + DISCOVERY_TIME
        while not publisher.get_subscription_count() and time.monotonic() < deadline:
            time.sleep(SOON)
        return publisher.get_subscription_count() > 0

    def stop_publishing(self) -> None:
        """Send a last command of zero torque and withdraw the publisher."""
        last, self._commands = self._commands, NullPublisher()
        last.publish(self._controller.log.zero_command())
        time.sleep(LAST_WORD)  # best-effort subscribers acknowledge nothing
        self._node.withdraw(last)

    def publish_command(self) -> None:
        """Publish the command of the last answer."""
        self._commands.publish(self._controller.command)

    def publish_zero(self) -> None:
        """Publish zero torque, which answers no state."""
        self._commands.publish(self._controller.log.zero_command())

    def publish_log(self) -> None:
        """Publish which states were answered since the last call."""
        self._log.publish(self._controller.log.take())

    def publish_answer(self, code: int) -> None:
        """Publish the last command and, by the bits of its code, what goes with it."""
        self.publish_command()
        stamp = self._controller.stamp
        if (code & STATUS or self._status is None) and self._controller.status != self._status:
            self.publish_status(self._controller.applied_stamp)
        if code & TELEMETRY:
            for topic, fields in telemetry_fields(self._controller.telemetry).items():
                publisher, draft = self._telemetry[topic]
                publisher.publish(draft.encode(stamp, **fields))
        if code & LOG:
            self.publish_log()

    def publish_status(self, stamp: int, refused: str = '') -> None:
        """Publish and log the status since a stamp [ns], in the background."""
        before, self._status = self._status, self._controller.status
        self._node.background.do(
            partial(self._publish_status, stamp, before, self._status._replace(refused=refused))
        )

    def _publish_status(self, stamp: int, before: Status | None, status: Status) -> None:
        self._statuses.publish(status_message(stamp, status))
        logger = self._node.get_logger()
        if status.law != self._law:
            self._law = status.law
            self._active_law.publish(layouts.text_message(status.law))
            logger.info(f'law {status.law}')
        if status.delay != (before.delay if before else ''):
            logger.info(f'delay of the states: {status.delay}')
        if status.fault != (before.fault if before else None):
            if status.fault:
                text = self._controller.explain(status.fault).text
                logger.error(f'fault: {text}; ~/clear_fault ends the safe action')
            else:
                logger.info('fault cleared')
        elif status.active_limits and status.active_limits != (
            before.active_limits if before else 0
        ):
            text = f'limits acted: {limits_text(status.active_limits)}'
            logger.warning(text, throttle_duration_sec=1.0)
