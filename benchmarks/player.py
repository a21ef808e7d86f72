"""The player against its bag: 3 topics of 1 kHz, in real time and fast.

Usage: python benchmarks/player.py [seconds of motion]
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import rclpy
from mcap.reader import make_reader
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from parallel_robot_analysis.processes import command
from parallel_robot_bags.indexed_reader import BagReader
from parallel_robot_base import topics
from parallel_robot_ros.message_types import message_class
from parallel_robot_ros.subscription import qos_of

PLAYED = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
NAMES = [f'/{topic.name}' for topic in PLAYED]
QUIET = 1.0  # s without a message: there will be no more


def reading(bag: Path) -> None:
    """Time to read one message, beside the reader of mcap."""
    begun = time.perf_counter()
    reader = BagReader(bag)
    opened = time.perf_counter()
    count = sum(1 for _ in reader.messages(NAMES, 0))
    own = (time.perf_counter() - opened) / count
    (file,) = bag.glob('*.mcap')
    with file.open('rb') as stream:
        begun_peer = time.perf_counter()
        peer = sum(1 for _ in make_reader(stream).iter_messages(NAMES))
        theirs = (time.perf_counter() - begun_peer) / peer
    print(
        f'open {1e3 * (opened - begun):.1f} ms, read {1e6 * own:.2f} us a message '
        f'(mcap: {1e6 * theirs:.2f})'
    )


def play(node: Node, executor: EventsExecutor, bag: Path, *words: str) -> None:
    """Play once and compare what arrives with the bag."""
    heard: dict[str, list[tuple[int, bytes]]] = defaultdict(list)

    def listen(topic: topics.Topic) -> object:
        stream = heard[f'/{topic.name}']

        def take(data: bytes) -> None:
            stream.append((time.monotonic_ns(), data))

        kind = message_class(topic.type)
        return node.create_subscription(kind, topic.name, take, qos_of(topic), raw=True)

    subscriptions = [listen(topic) for topic in PLAYED]
    client = node.create_client(Trigger, 'player/resume')
    module = 'parallel_robot_bags.player_node'
    process = subprocess.Popen(
        command(module, str(bag), '--pause', '--topics', *NAMES, *words), stderr=subprocess.DEVNULL
    )
    never = Future()
    while not (all(node.count_publishers(name) for name in NAMES) and client.service_is_ready()):
        executor.spin_until_future_complete(never, timeout_sec=0.1)
    executor.spin_until_future_complete(never, timeout_sec=QUIET)
    idle = processor_seconds(process.pid)
    resumed = client.call_async(Trigger.Request())
    before, used = -1, idle
    while process.poll() is None or before < sum(map(len, heard.values())):
        before = sum(map(len, heard.values()))
        executor.spin_until_future_complete(never, timeout_sec=QUIET)
        used = processor_seconds(process.pid) or used
    assert resumed.done()
    expected: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    for message in BagReader(bag).messages(NAMES, 0):
        expected[message.topic].append((message.log_time, message.data))
    print(f'{" ".join(words) or "--rate 1"}, exit code {process.returncode}')
    for name in NAMES:
        arrivals = [when for when, _ in heard[name]]
        missing = len(expected[name]) - len(arrivals)
        same = [data for _, data in heard[name]] == [data for _, data in expected[name]]
        seconds = (arrivals[-1] - arrivals[0]) * 1e-9
        rate = (len(arrivals) - 1) / seconds
        due = (expected[name][-1][0] - expected[name][0][0]) * 1e-9
        print(
            f'  {name:<28}{missing} of {len(expected[name])} missing, '
            f'{"same bytes in the same order" if same else "NOT the same"}, {rate:.2f} Hz, '
            f'{100 * (due / seconds - 1):+.4f} %'
        )
        late = [
            (when - arrivals[0]) - (log_time - expected[name][0][0])
            for when, (log_time, _) in zip(arrivals, expected[name], strict=False)
        ]
        if '--fast' not in words:
            quantiles = statistics.quantiles(late, n=100)
            print(
                f'  {"":<28}arrival after its time, less the first: '
                f'p50 {1e-6 * quantiles[49]:.3f}, p99 {1e-6 * quantiles[98]:.3f}, '
                f'max {1e-6 * max(late):.3f} ms'
            )
    print(f'  processor of the player: {used - idle:.2f} s, and {idle:.2f} s to start')
    node.destroy_client(client)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)


def processor_seconds(pid: int) -> float:
    """Processor time of a process; 0 when it has ended."""
    try:
        fields = re.sub(r'.*\) ', '', Path(f'/proc/{pid}/stat').read_text()).split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def main() -> None:
    """Simulate a bag, play it in real time and fast."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    duration = sys.argv[1] if len(sys.argv) > 1 else '12'
    rclpy.init()
    executor = EventsExecutor()
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / 'bag'
        words = ['simulate', 'paper_circle', '--duration', duration, '--out', str(bag)]
        module = 'parallel_robot_analysis.command_line'
        subprocess.run(command(module, *words), check=True)
        reading(bag)
        for number, words in enumerate(([], ['--fast'])):
            node = rclpy.create_node(f'benchmark_{number}')
            executor.add_node(node)
            play(node, executor, bag, *words)
            executor.remove_node(node)
            node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
