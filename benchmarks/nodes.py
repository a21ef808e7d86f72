"""The four nodes: start, processor, round trip and losses in wall time, rate in lockstep.

Usage: python benchmarks/nodes.py [--help]
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import signal
import statistics
import subprocess
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from graph_processes import busy, end, nodes_below, start
from rows import Row, row, show

from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.background import STATE_INDEX
from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_model.processes.node_processes import MODULES, processor_seconds

COMMAND = ('-m', 'parallel_robot.cli.command_line')
LOOP = ('trajectory', 'plant', 'controller')
FIRST = {
    'trajectory': topics.REFERENCE,
    'plant': topics.JOINT_STATES,
    'controller': topics.ACTIVE_LAW,
}
PARTS = ('start', 'wall', 'lockstep')
DELAYS = ('round trip', 'delay')
PERIOD = 1e-3  # s
PATIENCE = 180.0  # s, for the first state of the motion
Figures = dict[tuple[str, str], float]  # by name and unit


class Report(NamedTuple):
    """What the plant says in its diagnostics, once a second."""

    at: float  # stamp [s]
    state: int  # index of the last state
    delays: dict[str, list[float]]  # p50, p99, max [ms] of the last second


class Listener:
    """Hears the reports of the plant of the nodes that run."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('benchmark')
        self.reports: list[Report] = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._listen, 10)

    def running(self, process: subprocess.Popen[str]) -> bool:
        """Take a message, if one comes in time; whether a process still runs."""
        rclpy.spin_once(self.node, timeout_sec=0.1)
        return process.poll() is None

    def _listen(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for item in message.status[0].values}
        state = values.get(STATE_INDEX, '')
        if not message.status[0].name.startswith('plant') or not state.isdigit():
            return
        delays = {
            name: [float(word) for word in value.split('/')]
            for key, value in values.items()
            if (name := key.partition(' p50')[0]) in DELAYS
        }
        at = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.reports.append(Report(at, int(state), delays))


def start_times(listener: Listener, repeats: int) -> list[Row]:
    """Time from the start of each node to its first message; of the recorder, to its bag."""
    node = listener.node
    seconds = defaultdict(list)
    for name in [name for name in MODULES for _ in range(repeats)]:
        heard: list[bytes] = []
        subscription = None
        if topic := FIRST.get(name):
            kind = message_class(topic.type)
            subscription = node.create_subscription(
                kind, topic.name, heard.append, qos_of(topic), raw=True
            )
        with tempfile.TemporaryDirectory() as directory:
            bag = Path(directory) / 'bag'
            begun = time.perf_counter()
            words = ['-m', MODULES[name], '--ros-args', '-p', f'recorder.out:={bag}']
            process = start(words, stderr=subprocess.DEVNULL)
            while process.poll() is None and not heard and not bag.exists():
                rclpy.spin_once(node, timeout_sec=0.02)
            if process.poll() is not None:
                raise RuntimeError(f'{name} ended with exit code {process.returncode}')
            seconds[name].append(time.perf_counter() - begun)
            end([process], signal.SIGINT)
        if subscription is not None:
            node.destroy_subscription(subscription)
    return [row(f'{name}: start to first message', 's', all_) for name, all_ in seconds.items()]


@contextlib.contextmanager
def run(words: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """The four nodes by ``parallel_robot run``; SIGINT if they still run at the end."""
    process = start([*COMMAND, 'run', 'paper_circle', *words], stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        end([process], signal.SIGINT)


@contextlib.contextmanager
def three_nodes(assignments: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """The nodes without a recorder, in lockstep, by hand; the last of them."""
    counts, processes = topics.subscribers(LOOP, lockstep=True), []
    try:
        for name in LOOP:
            words = ['time_mode=lockstep', f'subscribers={counts[name]}', *assignments]
            given = [word for pair in words for word in ('-p', pair.replace('=', ':=', 1))]
            command = ['-m', MODULES[name], '--ros-args', *given]
            processes.append(start(command, stderr=subprocess.DEVNULL))
        yield processes[-1]
    finally:
        end(processes, signal.SIGINT)


def wall(listener: Listener, seconds: float, bag: Path, settings: Sequence[str]) -> Figures:
    """A run in wall time, then `analyze`."""
    listener.reports.clear()
    pids: Mapping[str, int] = {}
    used: dict[str, list[tuple[float, float]]] = {name: [] for name in MODULES}
    with run(['--duration', str(seconds), '--out', str(bag), *settings]) as process:
        while listener.running(process):
            if len(pids) < len(MODULES):
                pids = nodes_below(process.pid)
            for name, pid in pids.items():
                with contextlib.suppress(OSError, IndexError):  # it has ended
                    used[name].append((time.time(), processor_seconds(pid)))
    if process.returncode:
        raise RuntimeError(f'run ended with exit code {process.returncode}')
    figures: Figures = {}
    reports = [report for report in listener.reports if 0 < report.state < seconds / PERIOD]
    begun = min(report.at - report.state * PERIOD for report in reports)
    for name, points in used.items():
        within = [point for point in points if begun <= point[0] <= begun + seconds]
        (t0, cpu0), (t1, cpu1) = within[0], within[-1]
        figures[f'processor, {name}', '%'] = 100 * (cpu1 - cpu0) / (t1 - t0)
    for delay in DELAYS:
        each = [report.delays[delay] for report in reports if delay in report.delays]
        p50, p99, largest = zip(*each, strict=True)
        figures[f'{delay}, p50', 'ms'] = statistics.median(p50)
        figures[f'{delay}, p99', 'ms'] = statistics.median(p99)
        figures[f'{delay}, max', 'ms'] = max(largest)
    report = bag.with_suffix('.json')
    start([*COMMAND, 'analyze', str(bag), '--json', str(report)], stdout=subprocess.DEVNULL).wait()
    result = json.loads(report.read_text())
    of = result['messages']
    answered = of[topics.COMMANDS.name]['count'] / of[topics.JOINT_STATES.name]['count']
    figures['states answered', '%'] = 100 * answered
    figures['messages missing in the bag', ''] = sum(each['missing'] or 0 for each in of.values())
    figures['steady error, rms', 'µm'] = 1e6 * result['steady']['xy_rms_m']
    return figures


def rate(listener: Listener, seconds: float, nodes: subprocess.Popen[str]) -> float:
    """Median over seconds of the steps a second of nodes in lockstep."""
    begun = time.time()  # the reports of those before may not have been read yet
    deadline = time.monotonic() + PATIENCE
    running: list[Report] = []
    while listener.running(nodes) and time.monotonic() < deadline:
        running = [r for r in listener.reports if r.state > 0 and r.at >= begun]
        if running and running[-1].at - running[0].at >= seconds:
            break
    return statistics.median(
        (b.state - a.state) / (b.at - a.at) for a, b in itertools.pairwise(running)
    )


def repeated(part: str, times: int, measure: Callable[[int], Figures]) -> list[Row]:
    """The figures of some runs."""
    values = defaultdict(list)
    for number in range(times):
        print(f'... {part}, {number + 1} of {times}', flush=True)
        for key, value in measure(number).items():
            values[key].append(value)
    return [row(f'{part}: {name}', unit, each) for (name, unit), each in values.items()]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--only', choices=PARTS, help='one part; default: all')
    add('--rounds', type=int, default=3, metavar='N', help='runs of each kind, default 3')
    add('--seconds', type=float, default=12.0, metavar='T', help='of each run, default 12')
    add('--starts', type=int, default=5, metavar='N', help='starts of each node, default 5')
    add('--busy', type=int, default=0, metavar='N', help='busy processes per core beside it')
    add('--set', action='append', default=[], dest='assignments', metavar='KEY=VALUE')
    given = parser.parse_args()
    settings = [word for pair in given.assignments for word in ('--set', pair)]
    lockstep = ['--time-mode', 'lockstep', *settings, '--duration']
    found: list[Row] = []
    rclpy.init(args=[])
    with contextlib.ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        with run([*lockstep, '0.1', '--out', str(directory / 'warm')]) as process:
            process.wait()  # what is not yet compiled
        stack.enter_context(busy(given.busy))
        listener = Listener()

        def rates(number: int) -> Figures:
            with three_nodes(given.assignments) as nodes:
                alone = rate(listener, given.seconds, nodes)
            out = ['--out', str(directory / f'lockstep_{number}')]
            with run([*lockstep, str(100 * given.seconds), *out]) as nodes:
                recorded = rate(listener, given.seconds, nodes)
            return {('three nodes', 'steps/s'): alone, ('with recorder', 'steps/s'): recorded}

        def walls(number: int) -> Figures:
            return wall(listener, given.seconds, directory / f'wall_{number}', settings)

        if given.only in (None, 'start'):
            found += start_times(listener, given.starts)
        if given.only in (None, 'wall'):
            found += repeated('wall', given.rounds, walls)
        if given.only in (None, 'lockstep'):
            found += repeated('lockstep', given.rounds, rates)
        listener.node.destroy_node()
    show(found)


if __name__ == '__main__':
    main()
