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

import checkout  # noqa: F401
import rclpy
from mcap.reader import make_reader
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from rows import Row, row, show
from std_srvs.srv import Trigger

from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_model.processes.node_processes import command

PLAYED = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
NAMES = [f'/{topic.name}' for topic in PLAYED]
QUIET = 1.0  # s without a message: there will be no more


def reading(bag: Path) -> list[Row]:
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
    return [
        row('open a bag', 'ms', [1e3 * (opened - begun)]),
        row('read a message', 'us', [1e6 * own]),
        row('read a message by the reader of mcap', 'us', [1e6 * theirs]),
    ]


def play(node: Node, executor: EventsExecutor, bag: Path, *words: str) -> list[Row]:
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
    module = 'parallel_robot.bags.player_node'
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
    if process.returncode:
        sys.exit(f'the player ended with exit code {process.returncode}')
    mode = ' '.join(words) or '--rate 1'
    rates, late, drifts, missing, wrong = [], [], [], 0, 0
    for name in NAMES:
        arrivals = [when for when, _ in heard[name]]
        missing += len(expected[name]) - len(arrivals)
        wrong += [data for _, data in heard[name]] != [data for _, data in expected[name]]
        seconds = (arrivals[-1] - arrivals[0]) * 1e-9
        rates.append((len(arrivals) - 1) / seconds)
        due = (expected[name][-1][0] - expected[name][0][0]) * 1e-9
        drifts.append(100 * (due / seconds - 1))
        late += [
            1e-6 * ((when - arrivals[0]) - (log_time - expected[name][0][0]))
            for when, (log_time, _) in zip(arrivals, expected[name], strict=False)
        ]
    found = [
        row(f'{mode}: messages missing', '', [missing], '<= 0'),
        row(f'{mode}: topics that are not the same bytes in order', '', [wrong], '<= 0'),
        row(f'{mode}: rate of a topic', 'Hz', rates),
    ]
    if '--fast' not in words:
        found.append(row(f'{mode}: deviation of the rate', '%', drifts))
        found.append(row(f'{mode}: arrival after its time, less the first', 'ms', late))
        last = statistics.quantiles(late, n=100)[98]
        found.append(row(f'{mode}: the same, 99 % of the messages', 'ms', [last]))
        share = 100 * (used - idle) / (1e-3 * len(expected[NAMES[0]]))
        found.append(row(f'{mode}: processor', '% of a core', [share]))
    node.destroy_client(client)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)
    return found


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
        module = 'parallel_robot.cli.command_line'
        subprocess.run(command(module, *words), check=True)
        found = reading(bag)
        for number, words in enumerate(([], ['--fast'])):
            node = rclpy.create_node(f'benchmark_{number}')
            executor.add_node(node)
            found += play(node, executor, bag, *words)
            executor.remove_node(node)
            node.destroy_node()
    rclpy.shutdown()
    show(found)


if __name__ == '__main__':
    main()
