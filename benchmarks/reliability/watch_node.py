"""Node that watches a loop: keeps its messages as bytes, asks its nodes, judges nothing."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from rclpy.task import Future
from reliability.loop import NODES

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.messages import cdr, topics
from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_model.nodes.ros_client import Services, messages_of, reported

PATIENCE = 2.0  # s, for an answer
ASKED = ('ready', 'set_parameters')  # services of every node
WATCHED = (topics.JOINT_STATES, topics.COMMANDS, topics.POSE, topics.POSE_REFERENCE)


class Watch:
    """Messages of a loop since :meth:`forget`, and services of its nodes."""

    def __init__(self) -> None:
        """Listen, in a thread of its own."""
        # messages by topic
        self.heard: dict[topics.Topic, list[bytes]] = {topic: [] for topic in WATCHED}
        # (time of reception [ns], text) of each status with a fault
        self.faults: list[tuple[int, str]] = []
        self.fault = ''  # at present
        # last (time of reception [ns], level, message, figures) of each node
        self.diagnostics: dict[str, tuple[int, int, str, dict[str, str]]] = {}
        self._context = Context()
        self._context.init(args=[])
        self._node = node = rclpy.create_node('watch', context=self._context)
        for topic in WATCHED:
            kind, qos = message_class(topic.type), qos_of(topic)
            node.create_subscription(kind, topic.name, self.heard[topic].append, qos, raw=True)
        latched = qos_of(topics.STATUS)
        node.create_subscription(DiagnosticArray, topics.STATUS.name, self._on_status, latched)
        node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, QoSProfile(depth=100)
        )
        self._services = Services(node)
        self._services.ready('controller/clear_fault', 'plant/reset')
        self._services.ready(*(f'{name}/{each}' for name in NODES for each in ASKED))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def forget(self) -> None:
        """Begin anew."""
        for messages in self.heard.values():
            messages.clear()
        self.faults.clear()

    def trigger(self, service: str, patience: float = PATIENCE) -> tuple[bool, str] | None:
        """Success and message of a service; None when it does not answer."""
        answer = self._call(service, patience)
        return None if answer is None else (answer.success, answer.message)

    def start(self, stamp: int) -> bool:
        """Give all nodes the stamp of t = 0 [ns]; whether they took it."""
        given = messages_of({'start_stamp': stamp})
        services = [f'{name}/set_parameters' for name in NODES]
        answers = [self._call(name, PATIENCE, parameters=given) for name in services]
        return all(answer is not None and answer.results[0].successful for answer in answers)

    def close(self) -> None:
        """Leave."""
        self._ended.set()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _call(self, name: str, patience: float, **fields: Any) -> Any:
        deadline = time.monotonic() + patience
        if not self._services[name].wait_for_service(patience):
            return None
        future = self._services.send(name, **fields)
        while not future.done() and time.monotonic() < deadline:
            time.sleep(0.005)
        return future.result() if future.done() else None

    def _spin(self) -> None:
        executor = EventsExecutor(context=self._context)
        executor.add_node(self._node)
        while not self._ended.is_set():
            executor.spin_until_future_complete(Future(), timeout_sec=0.2)
        executor.remove_node(self._node)

    def _on_status(self, message: DiagnosticArray) -> None:
        fault = reported(message.status[0]).get('fault', 'none')
        self.fault = '' if fault == 'none' else fault
        if self.fault:
            self.faults.append((time.time_ns(), self.fault))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = reported(status)
            level = status.level[0] if isinstance(status.level, bytes) else status.level
            name = status.hardware_id.rpartition('/')[2]
            self.diagnostics[name] = (time.time_ns(), level, status.message, figures)


def decoded(layout: cdr.Layout, messages: Sequence[bytes]) -> np.ndarray:
    """Messages of one layout as records.

    Raises:
        RunError: a message is of another layout.
    """
    rows = [data[: layout.dtype.itemsize] for data in messages]  # which may still grow
    records = layout.decode(b''.join(rows), len(rows))
    if records is None:
        raise RunError(f'a message that is not as expected: {layout.type_name}')
    return records
