"""Node that passes topics on under another name, and does to them what it is told.

Usage: python -m reliability.relay_node KEY ...    (states, commands, references)

Each line of its input names an effect and, if not all, the topic: ``{"drop": 0.05}``,
``{"topic": "states", "delay": 0.01}``, ``{}``.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections import deque
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from reliability.effects import TOPICS, Effect, Line, relayed

from parallel_robot_model.nodes.connections import message_class, qos_of


class Relay:
    """One topic on its way through; a thread of its own passes on what waits."""

    def __init__(self, node: Node, key: str, seed: int) -> None:
        """Subscribe and publish."""
        topic = TOPICS[key]
        kind = message_class(topic.type)
        self._line = Line(seed)
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._changed = threading.Condition()
        self._publisher = node.create_publisher(kind, relayed(key), qos_of(topic))
        node.create_subscription(kind, topic.name, self._take, qos_of(topic), raw=True)
        threading.Thread(target=self._pass_on, daemon=True).start()

    def change(self, effect: Effect) -> None:
        """Apply another effect from now on."""
        with self._changed:
            self._line.change(effect, time.monotonic())

    def _take(self, data: bytes) -> None:
        with self._changed:
            now = time.monotonic()
            due = self._line.due(now)
            if due is None:
                return
            message = self._line.falsify(data)
            if due <= now and not self._waiting:
                self._publisher.publish(message)
            else:
                self._waiting.append((due, message))
                self._changed.notify()

    def _pass_on(self) -> None:
        with self._changed:
            while True:
                while not self._waiting:
                    self._changed.wait()
                left = self._waiting[0][0] - time.monotonic()
                if left > 0.0:
                    self._changed.wait(left)
                else:
                    self._publisher.publish(self._waiting.popleft()[1])


def main() -> None:
    """Relay until the input ends."""
    rclpy.init(args=[])
    node = rclpy.create_node('relay')
    relays = {key: Relay(node, key, seed) for seed, key in enumerate(sys.argv[1:])}
    ended = threading.Event()

    def obey() -> None:
        for line in sys.stdin:
            words: dict[str, Any] = json.loads(line)
            key = words.pop('topic', None)
            for relay in [relays[key]] if key else relays.values():
                relay.change(Effect(**words))
        ended.set()

    threading.Thread(target=obey, daemon=True).start()
    executor = EventsExecutor()
    executor.add_node(node)
    while not ended.is_set():
        executor.spin_until_future_complete(Future(), timeout_sec=0.2)
    executor.remove_node(node)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
