"""The recorder at 6 topics of 1 kHz: processor share and losses, against what was published.

Usage: python benchmarks/recorder.py [seconds]
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import checkout  # noqa: F401
import rclpy
from mcap.reader import make_reader
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rows import row, show

from parallel_robot.bags.files.bag_files import MESSAGES
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import DEPTH
from parallel_robot_model.nodes.connections import message_class
from parallel_robot_model.processes.node_processes import command
from parallel_robot_model.processes.realtime import DeadlineThread

JOINTS = ('joint1', 'joint2', 'joint3')
TOPICS = {
    'states': layouts.joint_state((*JOINTS, 'passive1', 'passive2', 'passive3')),
    'errors': layouts.joint_state(JOINTS, ('position', 'velocity')),
    'efforts': layouts.joint_state(JOINTS, ('effort',)),
    'references': layouts.joint_trajectory(JOINTS),
    'poses': layouts.pose_stamped('base'),
    'more_states': layouts.joint_state(JOINTS),
}
TICKS = os.sysconf('SC_CLK_TCK')


def publish(count: int) -> None:
    """Publish `count` messages on every topic, one a millisecond, to who listens."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('source')
    publishers = {
        name: node.create_publisher(message_class(layout.type_name), name, QoSProfile(depth=DEPTH))
        for name, layout in TOPICS.items()
    }
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        time.sleep(0.05)
    left = count

    def tick(stamp: int) -> None:
        nonlocal left
        for name, publisher in publishers.items() if left > 0 else ():
            publisher.publish(TOPICS[name].encode(stamp))
        left -= 1

    thread = DeadlineThread(1_000_000, tick, lambda error: os._exit(1))
    thread.start()
    while left > 0:
        time.sleep(0.1)
    thread.stop()
    time.sleep(4.0)  # a receiver that lacks something asks within 3 s
    node.destroy_node()
    rclpy.shutdown()


def main() -> None:
    """Record a source, then compare."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / 'bag'
        names = ', '.join(f'"{name}"' for name in TOPICS)
        recorder = subprocess.Popen(
            [
                *command('parallel_robot.bags.writing.recorder_node', '--ros-args'),
                *('-p', f'recorder.out:={bag}', '-p', f'recorder.topics:=[{names}]'),
            ],
            stderr=subprocess.DEVNULL,
        )
        source = get_context('spawn').Process(target=publish, args=(1000 * seconds,))
        source.start()
        time.sleep(3.0)  # discovery; the source waits for the recorder
        begun, used = time.monotonic(), processor_seconds(recorder.pid)
        time.sleep(seconds - 2.0)
        share = (processor_seconds(recorder.pid) - used) / (time.monotonic() - begun)
        source.join()
        recorder.send_signal(signal.SIGINT)
        code = recorder.wait()
        (file,) = bag.glob('*.mcap')
        with file.open('rb') as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            certificate = next(r.metadata for r in reader.iter_metadata() if r.name == MESSAGES)
        counts = {
            channel.topic: summary.statistics.channel_message_counts[channel.id]
            for channel in summary.channels.values()
        }
    if code:
        sys.exit(f'the recorder ended with exit code {code}')
    missing = [1000 * seconds - counts[f'/{name}'] for name in TOPICS]
    print(f'{seconds} s, {1000 * seconds * len(TOPICS)} messages')
    print(f'certificates: {", ".join(f"{name} {certificate[name]}" for name in TOPICS)}')
    show(
        [
            row('messages missing', '', [sum(missing)], '<= 0'),
            row('processor', '% of a core', [100 * share]),
        ]
    )


def processor_seconds(pid: int) -> float:
    """Processor time of a process."""
    fields = re.sub(r'.*\) ', '', Path(f'/proc/{pid}/stat').read_text()).split()
    return (int(fields[11]) + int(fields[12])) / TICKS


if __name__ == '__main__':
    main()
