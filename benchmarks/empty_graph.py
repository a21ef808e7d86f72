"""An empty twin of the suite's graph: same processes, messages and quality of service; no work.

Usage: python benchmarks/empty_graph.py ROLE [--lockstep] [--samples N] [--bag FILE]

Every role is a process of its own with an EventsExecutor, serialised bytes at both ends, and
/diagnostics once a second; transport and priority are the suite's. It prints `ready` when all its
topics are matched, reads the common start [ns] as a line from its standard input, and after
SIGTERM prints what it has published.

- trajectory: constant references at 1 kHz from a deadline thread. In lockstep it counts states and
  keeps the references 100 to 200 samples ahead, in batches.
- plant: constant states at 1 kHz from a deadline thread; in lockstep, the clock and the next state
  as soon as a command arrives.
- controller: answers each state with constant bytes at once, every tenth with its telemetry.
- recorder: writes each message, in the callback that receives it, with mcap.Writer: chunks as
  large as the suite's and with the index that makes a bag readable, no compression, no checksum
  of the data. No queue, no thread, no look at the message.
"""

from __future__ import annotations

import argparse
import gc
import json
import signal
import sys
import time
from functools import partial
from pathlib import Path

import checkout  # noqa: F401
import numpy as np
import rclpy
from empty_node import TELEMETRY, EmptyNode
from mcap.writer import CompressionType, Writer
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes import middleware
from parallel_robot_model.nodes.background import STATE_INDEX
from parallel_robot_model.nodes.connections import listen, qos_of
from parallel_robot_model.processes import realtime

AHEAD = 20_000_000  # ns, how long before its stamp a reference is sent
BATCH = 200  # samples that the references are at most ahead (lockstep)
CHUNK_SIZE = 255 * 1024  # bytes


class EmptyTrajectory(EmptyNode):
    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__('trajectory', arguments)
        self._sent, self._seen = -1, -1
        self.offer(topics.REFERENCE, topics.POSE_REFERENCE)
        if self.lockstep:
            self.hear(topics.JOINT_STATES, self._on_state)

    def begin(self, stamp: int) -> None:
        super().begin(stamp)
        if not self.lockstep:
            self.start_timer(self._tick, AHEAD)

    def _tick(self, _: int) -> None:
        self._sent += 1
        self.publish(topics.REFERENCE)
        if self._sent % topics.SLOW == 0:
            self.publish(topics.POSE_REFERENCE)

    def _on_state(self, _: bytes) -> None:
        self._seen += 1
        if self._sent < self._seen + BATCH // 2:
            while self._sent < self._seen + BATCH:
                self._tick(0)


class EmptyPlant(EmptyNode):
    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__('plant', arguments)
        self._index = -1  # of the last state
        self._answered = True
        self._published_at = 0  # ns, monotonic
        self._round_trips: list[float] = []  # ms
        self._delays: list[float] = []  # ms
        self.offer(topics.JOINT_STATES, topics.POSE, topics.MARKERS)
        if self.lockstep:
            self.offer(topics.CLOCK)
        self.hear(topics.COMMANDS, self._on_command)

    def begin(self, stamp: int) -> None:
        super().begin(stamp)
        if self.lockstep:
            self._publish_state()
        else:
            self.start_timer(self._tick)

    def figures(self) -> dict[str, str]:
        figures = {STATE_INDEX: str(self._index)} if self._index >= 0 else {}
        for name, values in (('delay', self._delays), ('round trip', self._round_trips)):
            if values:
                p50, p99, largest = np.percentile(values, [50, 99, 100])
                figures[f'{name} p50/p99/max [ms]'] = f'{p50:.3f}/{p99:.3f}/{largest:.3f}'
                values.clear()
        return figures

    def _tick(self, stamp: int) -> None:
        self._publish_state()
        self._delays.append((time.time_ns() - stamp) * 1e-6)

    def _publish_state(self) -> None:
        self._index += 1
        if self.lockstep:
            self.publish(topics.CLOCK)
        self._answered = False
        self._published_at = time.monotonic_ns()
        self.publish(topics.JOINT_STATES)
        if self._index % topics.SLOW == 0:
            self.publish(topics.POSE)

    def _on_command(self, _: bytes) -> None:
        if not self._answered:
            self._round_trips.append((time.monotonic_ns() - self._published_at) * 1e-6)
        self._answered = True
        if self.lockstep:
            self._publish_state()


class EmptyController(EmptyNode):
    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__('controller', arguments)
        self._count = 0
        self.offer(topics.COMMANDS, *TELEMETRY)
        self.publish(topics.ACTIVE_LAW)
        self.publish(topics.STATUS)
        self.hear(topics.REFERENCE, lambda _: None)
        self.hear(topics.JOINT_STATES, self._on_state)

    def _on_state(self, _: bytes) -> None:
        self.publish(topics.COMMANDS)
        if self._count % topics.SLOW == 0:
            for topic in TELEMETRY:
                if topic.every:
                    self.publish(topic)
        self._count += 1


class EmptyRecorder(EmptyNode):
    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__('recorder', arguments)
        self._writer = Writer(str(arguments.bag), CHUNK_SIZE, CompressionType.NONE)
        self._writer.start('ros2', 'empty_graph')
        for topic in topics.RECORDED:
            schema = self._writer.register_schema(topic.type, 'ros2msg', b'')
            channel = self._writer.register_channel(f'/{topic.name}', 'cdr', schema)
            qos = qos_of(topic)
            qos.depth = topics.DEPTH
            listen(self, topic, qos, partial(self._take, channel))

    def _take(self, channel: int, data: bytes, received: int, _: int) -> None:
        self._writer.add_message(channel, received, data, received)

    def close(self) -> None:
        super().close()
        self._writer.finish()


ROLES = {
    'trajectory': EmptyTrajectory,
    'plant': EmptyPlant,
    'controller': EmptyController,
    'recorder': EmptyRecorder,
}


def main() -> None:
    """Run one role until SIGTERM."""
    parser = argparse.ArgumentParser(description='One process of the empty twin.')
    parser.add_argument('role', choices=ROLES)
    parser.add_argument('--lockstep', action='store_true', help='the plant waits for each command')
    parser.add_argument('--samples', type=int, default=0, help='last state of the motion (wall)')
    parser.add_argument('--bag', type=Path, help='file of the recorder')
    parser.add_argument(
        '--subscribers', type=json.loads, default={}, help='JSON: topic to how many it waits for'
    )
    for key in ('middleware', 'realtime'):
        parser.add_argument(f'--{key}', default=config.default(key), help="as the suite's")
    arguments = parser.parse_args()
    stop: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stop.append(number))
    with middleware.chosen_transport(arguments.middleware):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = ROLES[arguments.role](arguments)
    while not (stop or node.matched()):
        time.sleep(0.02)
    print('ready', flush=True)
    stamp = int(sys.stdin.readline() or 0)
    executor = EventsExecutor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()
    if arguments.realtime == 'auto' and not arguments.lockstep:
        realtime.acquire(realtime.LISTENER if arguments.role == 'recorder' else realtime.LOOP)
    node.begin(stamp)
    never = Future()
    while not stop:
        executor.spin_until_future_complete(never, timeout_sec=0.1)
    node.close()
    print(json.dumps(node.published), flush=True)
    executor.remove_node(node)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
