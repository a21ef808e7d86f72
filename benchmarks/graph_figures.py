"""What is measured of a graph, with the same definitions for the suite's and for its empty twin.

Figures are None where there are none: a run that failed, say.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import statistics
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from graph_processes import start
from graphs import COMMAND, LOOK, Graph, Outcome, command, nodes, settings, twin
from mcap.reader import make_reader

from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.background import STATE_INDEX
from parallel_robot_model.processes.node_processes import MODULES, processor_seconds

PERIOD = 1e-3  # s
PATIENCE = 180.0  # s, for the first state of the motion
DELAYS = ('delay', 'round trip')
Figures = dict[str, Any]


class Report(NamedTuple):
    """What the plant says in its diagnostics, once a second."""

    at: float  # stamp [s]
    state: int  # index of the last state
    # p50, p99, max [ms] of the last second, by the name of the delay
    delays: dict[str, list[float]]


class Listener:
    """Hears the reports of the plant of the graph that runs."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('benchmark')
        self.reports: list[Report] = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._listen, 10)

    def spin(self, seconds: float = LOOK) -> None:
        """Take a message, if one comes in time."""
        rclpy.spin_once(self.node, timeout_sec=seconds)

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


def wall_empty(
    listener: Listener, seconds: float, directory: Path, assignments: Sequence[str]
) -> Figures:
    """The empty twin in wall time."""
    outcome, bag = Outcome(), directory / 'empty.mcap'
    with twin(False, round(seconds / PERIOD), bag, outcome, assignments) as graph:
        figures = _watch(graph, listener, seconds)
    with bag.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    counts = {
        channel.topic.lstrip('/'): summary.statistics.channel_message_counts.get(number, 0)
        for number, channel in summary.channels.items()
    }
    missing = sum(outcome.published[name] - count for name, count in counts.items())
    bag.unlink()
    return figures | _of_bag(outcome, counts, missing)


def wall_ours(
    listener: Listener, seconds: float, directory: Path, assignments: Sequence[str]
) -> Figures:
    """The suite in wall time, then `analyze`."""
    outcome, bag = Outcome(), directory / f'ours_{time.monotonic_ns()}'
    words = ['paper_circle', '--duration', str(seconds), '--out', str(bag)]
    words += settings(assignments)
    with command(words, outcome) as graph:
        figures = _watch(graph, listener, seconds)
    report = directory / 'report.json'
    report.unlink(missing_ok=True)
    start(
        [*COMMAND, 'analyze', str(bag), '--json', str(report)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ).wait()
    if not report.exists():
        return figures | _of_bag(outcome, {}, None)
    result = json.loads(report.read_text())
    counts = {name: row['count'] for name, row in result['messages'].items()}
    missing = sum(row['missing'] or 0 for row in result['messages'].values())
    rms = result['steady']['xy_rms_m']
    return {
        **figures,
        **_of_bag(outcome, counts, missing),
        'steady_rms_um': None if rms is None else 1e6 * rms,
        'timing': result.get('timing'),
    }


def lockstep_empty(
    listener: Listener, seconds: float, directory: Path, recorded: bool, assignments: Sequence[str]
) -> Figures:
    """Steps a second of the empty twin."""
    bag = directory / 'empty.mcap' if recorded else None
    with twin(True, 0, bag, Outcome(), assignments) as graph:
        figures = _rate(graph, listener, seconds)
    if bag is not None:
        bag.unlink()
    return figures


def lockstep_ours(
    listener: Listener, seconds: float, directory: Path, recorded: bool, assignments: Sequence[str]
) -> Figures:
    """Steps a second of the suite: by `run`, or without a recorder by hand."""
    if not recorded:
        with nodes(assignments) as graph:
            return _rate(graph, listener, seconds)
    bag = directory / f'lockstep_{time.monotonic_ns()}'
    words = ['paper_circle', '--time-mode', 'lockstep', '--duration', str(100 * seconds)]
    words += settings(assignments)
    with command([*words, '--out', str(bag)], Outcome()) as graph:
        return _rate(graph, listener, seconds)


def _watch(graph: Graph, listener: Listener, seconds: float) -> Figures:
    """Watch a run in wall time to its end: processor over the motion, delays."""
    listener.reports.clear()
    pids: Mapping[str, int] = {}
    used: dict[str, list[tuple[float, float]]] = {name: [] for name in MODULES}
    while graph.running():
        listener.spin()
        if len(pids) < len(MODULES):
            pids = graph.pids()
        for name, pid in pids.items():
            with contextlib.suppress(OSError, IndexError):  # it has ended
                used[name].append((time.time(), processor_seconds(pid)))
    running = [report for report in listener.reports if 0 < report.state < seconds / PERIOD]
    begun = min((report.at - report.state * PERIOD for report in running), default=0.0)
    shares = {}
    for name, points in used.items():
        within = [point for point in points if begun <= point[0] <= begun + seconds]
        if len(within) > 1:
            (t0, cpu0), (t1, cpu1) = within[0], within[-1]
            shares[name] = 100 * (cpu1 - cpu0) / (t1 - t0)
    figures: Figures = {'processor_percent': shares}
    for delay in DELAYS:
        rows = [report.delays[delay] for report in running if delay in report.delays]
        key = delay.replace(' ', '_') + '_ms'
        if rows:
            p50, p99, largest = zip(*rows, strict=True)
            median = statistics.median
            figures[key] = {'p50': median(p50), 'p99': median(p99), 'max': max(largest)}
        else:
            figures[key] = dict.fromkeys(('p50', 'p99', 'max'))
    return figures


def _rate(graph: Graph, listener: Listener, seconds: float) -> Figures:
    """Watch a run in lockstep for some seconds: median over seconds of its rate."""
    begun = time.time()  # the reports of the graph before may not have been read yet
    deadline = time.monotonic() + PATIENCE
    running: list[Report] = []
    while graph.running() and time.monotonic() < deadline:
        listener.spin()
        running = [r for r in listener.reports if r.state > 0 and r.at >= begun]
        if running and running[-1].at - running[0].at >= seconds:
            break
    rates = [(b.state - a.state) / (b.at - a.at) for a, b in itertools.pairwise(running)]
    return {'steps_per_s': statistics.median(rates) if rates else None}


def _of_bag(outcome: Outcome, counts: Mapping[str, int], missing: int | None) -> Figures:
    states = counts.get(topics.JOINT_STATES.name)
    return {
        'exit_code': outcome.code,
        'said': outcome.said,
        'messages': sum(counts.values()),
        'missing': missing,
        'answered': counts.get(topics.COMMANDS.name, 0) / states if states else None,
    }
