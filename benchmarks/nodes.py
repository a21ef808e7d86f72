"""The nodes in real time: start, rate, losses, round trip, processor share; rate in lockstep.

Usage: python benchmarks/nodes.py [seconds of motion]
"""

from __future__ import annotations

import itertools
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, KeyValue

from parallel_robot_analysis.processes import MODULES
from parallel_robot_interface import topics
from parallel_robot_interface.ros_node import message_class, qos_of

TICKS = os.sysconf('SC_CLK_TCK')
FIRST = {
    'trajectory': topics.REFERENCE,
    'plant': topics.JOINT_STATES,
    'controller': topics.ACTIVE_LAW,
}
RUN = [sys.executable, '-m', 'parallel_robot_analysis.command_line']


def start_times(repeats: int = 5) -> None:
    """Time from the start of a process to its first message at a subscriber."""
    print(f'start to first message, {repeats} starts: median (min - max)')
    for name, topic in FIRST.items():
        seconds = []
        for _ in range(repeats):
            node = rclpy.create_node('benchmark')
            heard: list[bytes] = []
            kind = message_class(topic.type)
            node.create_subscription(kind, topic.name, heard.append, qos_of(topic), raw=True)
            begun = time.perf_counter()
            process = subprocess.Popen([sys.executable, '-m', MODULES[name]])
            while not heard:
                rclpy.spin_once(node, timeout_sec=0.05)
            seconds.append(time.perf_counter() - begun)
            process.terminate()
            process.wait()
            node.destroy_node()
        span = f'({min(seconds):.2f} - {max(seconds):.2f})'
        print(f'  {name:<12}{statistics.median(seconds):6.2f} s {span}')


def wall(duration: float, directory: Path) -> None:
    """One run in wall time."""
    node = rclpy.create_node('benchmark')
    figures: dict[str, list[list[float]]] = {'delay': [], 'round trip': []}

    def listen(message: DiagnosticArray) -> None:
        for item in values_of('/plant', message):
            name = item.key.split(' p50')[0]
            if name in figures:
                figures[name].append([float(word) for word in item.value.split('/')])

    node.create_subscription(DiagnosticArray, '/diagnostics', listen, 10)
    bag = directory / 'wall'
    process = subprocess.Popen(
        [*RUN, 'run', 'paper_circle', '--duration', str(duration), '--out', str(bag)],
        stdout=subprocess.DEVNULL,
    )
    cpu: dict[str, float] = {}
    while process.poll() is None:
        rclpy.spin_once(node, timeout_sec=0.2)
        cpu |= processor_seconds(process.pid)
    report = directory / 'wall.json'
    subprocess.run(
        [*RUN, 'analyze', str(bag), '--json', str(report)], check=True, stdout=subprocess.DEVNULL
    )
    result = json.loads(report.read_text())
    missing = sum(count['missing'] for count in result['messages'].values())
    count = sum(count['count'] for count in result['messages'].values())
    print(f'wall time, {duration:g} s, exit code {process.returncode}')
    print(f'  messages missing {missing} of {count + missing}')
    print(f'  steady error, rms {1e6 * result["steady"]["xy_rms_m"]:.2f} um')
    for name, rows in figures.items():
        p50, p99, largest = zip(*rows, strict=True)
        print(
            f'  {name:<11} p50 {statistics.median(p50):.3f}, p99 {statistics.median(p99):.3f} ms '
            f'(medians over seconds), max {max(largest):.3f} ms'
        )
    for name, seconds in cpu.items():
        print(
            f'  processor, {name:<11}{100 * seconds / duration:5.1f} % of a core, start included'
        )
    node.destroy_node()


def lockstep(duration: float, directory: Path) -> None:
    """One run in lockstep; the rate between two reports of the plant."""
    node = rclpy.create_node('benchmark')
    seen: list[tuple[float, int]] = []

    def listen(message: DiagnosticArray) -> None:
        for item in values_of('/plant', message):
            if item.key == 'state' and item.value.isdigit():
                seen.append((time.perf_counter(), int(item.value)))

    node.create_subscription(DiagnosticArray, '/diagnostics', listen, 10)
    words = ['run', 'paper_circle', '--time-mode', 'lockstep', '--duration', str(duration)]
    process = subprocess.Popen(
        [*RUN, *words, '--out', str(directory / 'lockstep')], stdout=subprocess.DEVNULL
    )
    while process.poll() is None:
        rclpy.spin_once(node, timeout_sec=0.2)
    rates = [(k1 - k0) / (t1 - t0) for (t0, k0), (t1, k1) in itertools.pairwise(seen) if k1 > k0]
    print(
        f'lockstep, {duration:g} s: {statistics.median(rates):.0f} steps/s (median over seconds)'
    )
    node.destroy_node()


def values_of(node: str, message: DiagnosticArray) -> list[KeyValue]:
    """Figures of one node, by its full name."""
    return [item for one in message.status if one.hardware_id == node for item in one.values]


def processor_seconds(parent: int) -> dict[str, float]:
    """Processor time of every node of a supervisor, by node name."""
    seconds = {}
    try:
        children = Path(f'/proc/{parent}/task/{parent}/children').read_text().split()
    except OSError:
        return {}
    for child in children:
        try:
            words = Path(f'/proc/{child}/cmdline').read_bytes().decode().split('\0')
            fields = re.sub(r'.*\) ', '', Path(f'/proc/{child}/stat').read_text()).split()
        except OSError:
            continue
        name = next((name for name, module in MODULES.items() if module in words), None)
        if name and len(fields) > 12:
            seconds[name] = (int(fields[11]) + int(fields[12])) / TICKS
    return seconds


def main() -> None:
    """Run all three."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 12.0
    rclpy.init()
    start_times()
    with tempfile.TemporaryDirectory() as directory:
        wall(duration, Path(directory))
        lockstep(duration, Path(directory))
    rclpy.shutdown()


if __name__ == '__main__':
    main()
