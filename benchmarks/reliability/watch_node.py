"""Node that watches a loop: keeps its messages as bytes, asks its nodes, judges nothing."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.task import Future
from reliability.loop import NODES
from std_srvs.srv import Trigger

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.messages import cdr, topics
from parallel_robot_model.nodes.connections import message_class, qos_of

PATIENCE = 2.0  # s, for an answer
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
        services = [f'{name}/ready' for name in NODES] + ['controller/clear_fault', 'plant/reset']
        self._clients = {name: node.create_client(Trigger, name) for name in services}
        self._set = {
            name: node.create_client(SetParameters, f'{name}/set_parameters') for name in NODES
        }
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
        answer = self._call(self._clients[service], Trigger.Request(), patience)
        return None if answer is None else (answer.success, answer.message)

    def start(self, stamp: int) -> bool:
        """Give all nodes the stamp of t = 0 [ns]; whether they took it."""
        parameter = Parameter('start_stamp', Parameter.Type.INTEGER, stamp).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        answers = [self._call(self._set[name], request, PATIENCE) for name in NODES]
        return all(answer is not None and answer.results[0].successful for answer in answers)

    def close(self) -> None:
        """Leave."""
        self._ended.set()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _call(self, client: Any, request: Any, patience: float) -> Any:
        deadline = time.monotonic() + patience
        if not client.wait_for_service(patience):
            return None
        future = client.call_async(request)
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
        fault = {item.key: item.value for item in message.status[0].values}.get('fault', 'none')
        self.fault = '' if fault == 'none' else fault
        if self.fault:
            self.faults.append((time.time_ns(), self.fault))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = {item.key: item.value for item in status.values}
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
