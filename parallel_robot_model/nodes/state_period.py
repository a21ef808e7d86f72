"""The period with which joint states come, for a node that is told ``period: auto``."""

from __future__ import annotations

import os
import time

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from parallel_robot_model.common.units import NANOSECONDS, usual_step
from parallel_robot_model.configuration.loop import MICROSECOND
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import JOINT_STATES, QUEUE
from parallel_robot_model.nodes.our_joints import OurJoints
from parallel_robot_model.nodes.subscription import listen

AUTO = 'auto'
FEW = 20  # steps from a state to the next, at least, of which the period is found
SPAN = NANOSECONDS // 2  # ns, over all of them, at least
LOOK = 0.1  # s, between two looks whether the states suffice
REMINDER = 5.0  # s, from one word that it still waits to the next


def wait_for_period(node: Node, joints: tuple[str, ...], end_with_parent: bool) -> int:
    """Wait for joint states, and find their period from their stamps.

    Args:
        node: The node that waits; nothing else of it happens meanwhile.
        joints: Names of the joints; messages of others are left out.
        end_with_parent: Whether the process ends when the one that started it has.

    Returns:
        The period, in whole microseconds [ns].
    """
    ours, stamps, parent = OurJoints(JOINT_STATES, joints), [], os.getppid()

    def take(data: bytes, _: int, number: int) -> None:
        stamp = None if ours.others(data) else layouts.header_stamp(data)
        if stamp is not None:
            stamps.append(stamp)

    qos = QoSProfile(depth=QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
    subscription = listen(node, JOINT_STATES, qos, take)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    told, period = -REMINDER, 0
    while not period:
        end = time.monotonic() + LOOK
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=LOOK)
        period = period_of(np.array(stamps, np.int64))
        if end_with_parent and os.getppid() != parent:
            raise SystemExit(0)
        if not period and end - told > REMINDER:
            node.get_logger().warning(f'period {AUTO}: waits for {subscription.topic_name}')
            told = end
    executor.remove_node(node)
    executor.shutdown()
    node.destroy_subscription(subscription)
    return period


def period_of(stamps: np.ndarray) -> int:
    """The period of states, of which single ones may be missing.

    Args:
        stamps: Their stamps, in the order in which they came [ns], shape (N,).

    Returns:
        The period, in whole microseconds [ns]; 0 if they are too few to tell.
    """
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if len(steps) < FEW or steps.sum() < SPAN:
        return 0
    return round(usual_step(steps) / MICROSECOND) * MICROSECOND
