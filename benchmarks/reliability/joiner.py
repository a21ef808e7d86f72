"""Processes that join the graph of a running loop, hear a state, and leave.

Usage: python -m reliability.joiner HOW_MANY AT_ONCE

Each is a fork of this one, which has imported everything and not touched the middleware: a fresh
participant without the processor time of a start of Python. One in some hundreds never leaves, for
Fast DDS spins in DomainParticipant::set_listener; it has heard its state, and a signal ends it.
"""

from __future__ import annotations

import os
import signal
import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from parallel_robot_model.messages import topics

PATIENCE = 10.0  # s, for the first state
LEAVING = 10  # s, for which a process may leave


def join() -> bool:
    """Join, hear a state, leave; whether one was heard."""
    rclpy.init(args=[])
    node = rclpy.create_node(f'joiner_{os.getpid()}')
    heard: list[bytes] = []
    node.create_subscription(JointState, topics.JOINT_STATES.name, heard.append, 10, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    deadline = time.monotonic() + PATIENCE
    while not heard and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
    if not heard:
        return False
    signal.alarm(LEAVING)
    node.destroy_node()
    rclpy.shutdown()
    return True


def main() -> int:
    """Let processes join; 1 when one of them heard nothing."""
    count, at_once = int(sys.argv[1]), int(sys.argv[2])
    begun, running, failed = 0, 0, 0
    while begun < count or running:
        if begun < count and running < at_once:
            begun, running = begun + 1, running + 1
            if os.fork() == 0:
                os._exit(0 if join() else 1)
            continue
        _, status = os.wait()
        running -= 1
        failed += status not in (0, signal.SIGALRM)
    if failed:
        print(f'{failed} of {count} heard nothing within {PATIENCE:g} s', file=sys.stderr)
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
