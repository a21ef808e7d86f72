"""Quality of service of the suite's topics, and subscriptions to messages as bytes."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from parallel_robot_model.messages.topics import DEPTH, Topic
from parallel_robot_model.nodes.message_types import message_class


def qos_of(topic: Topic) -> QoSProfile:
    """Quality of service of a topic of the suite."""
    if topic.latched:
        return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return QoSProfile(depth=DEPTH)


def listen(
    node: Node, topic: Topic, qos: QoSProfile, take: Callable[[bytes, int, int], None]
) -> Subscription:
    """Subscribe to the serialised messages of a topic, with what the middleware knows of each.

    Args:
        node: The node that subscribes.
        topic: Name and type.
        qos: Quality of service.
        take: Called with the message, the time of its reception [ns], and its number, which
            its publisher counts from 1 on; 0 if the middleware does not number messages.
    """

    def pass_on(*arguments: Any) -> None:
        # EventsExecutor passes message and information as one tuple (rclpy 7.1).
        data, information = arguments if len(arguments) == 2 else arguments[0]
        take(
            data,
            information['received_timestamp'],
            information['publication_sequence_number'] or 0,
        )

    signature = inspect.signature(lambda message, information: None)
    pass_on.__signature__ = signature  # type: ignore[attr-defined]
    return node.create_subscription(message_class(topic.type), topic.name, pass_on, qos, raw=True)
