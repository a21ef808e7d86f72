"""What holds up a loop that runs: changes of law and gains, parameter requests, late subscribers.

One run, in phases: with nothing, and with each kind of request. Of each phase: the pauses between
commands, the steps of the torque beyond the ramp and what a law itself asks for, and the
longest callbacks.

Usage: python benchmarks/switches.py [--help]
"""

from __future__ import annotations

import argparse
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from graph_processes import busy
from joins import JOINER, RUN
from mcap.reader import make_reader
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from parallel_robot_analysis.replay import replayed
from parallel_robot_bags import history, run_log
from parallel_robot_base import config, topics
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control.configuration import configure
from parallel_robot_control.laws import LAWS
from parallel_robot_control.messages import NO_FAULT

PATIENCE = 30.0  # s
LONGEST = 'longest callback [ms]'  # key of the diagnostics


class Phase(NamedTuple):
    """What was asked of the loop from a time to another [ns]."""

    name: str
    begin: int
    end: int
    requests: int


class Client:
    """Asks the controller, as `ros2 param` does, from one process."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node = rclpy.create_node('benchmark_switches')
        self.callbacks: list[tuple[int, str, float]] = []
        self._clients: dict[str, Any] = {}
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 100)

    def _take(self, array: DiagnosticArray) -> None:
        """Note the longest callback of a second of a node."""
        for status in array.status:
            values = {item.key: item.value for item in status.values}
            if LONGEST in values:
                length, _, name = values[LONGEST].partition(' ')
                what = f'{status.hardware_id} {name}'
                self.callbacks.append((time.time_ns(), what, float(length)))

    def rest(self, seconds: float) -> None:
        """Wait, while diagnostics come in."""
        due = time.monotonic() + seconds
        while (left := due - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=left)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Answer of a service of the controller."""
        client = self._clients.get(name) or self.node.create_client(kind, f'controller/{name}')
        self._clients[name] = client
        if not client.wait_for_service(PATIENCE):
            raise RuntimeError(f'no service {name}')
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=PATIENCE)
        return future.result()

    def set(self, **changes: Any) -> None:
        """Set parameters; `__` stands for a point."""
        parameters = [
            Parameter(key.replace('__', '.'), value=value).to_parameter_msg()
            for key, value in changes.items()
        ]
        answer = self.call(
            SetParameters, 'set_parameters', SetParameters.Request(parameters=parameters)
        )
        if not all(result.successful for result in answer.results):
            raise RuntimeError(answer.results[0].reason)

    def dump(self) -> None:
        """Ask for everything that `ros2 param dump` and `describe` ask for."""
        names = self.call(ListParameters, 'list_parameters', ListParameters.Request())
        wanted = list(names.result.names)
        self.call(GetParameters, 'get_parameters', GetParameters.Request(names=wanted))
        request = DescribeParameters.Request(names=wanted)
        self.call(DescribeParameters, 'describe_parameters', request)

    def listen(self) -> None:
        """Subscribe to a latched topic, as a late joiner does, and leave."""
        heard: list[Any] = []
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        name = topics.ACTIVE_LAW.name
        subscription = self.node.create_subscription(String, name, heard.append, qos)
        due = time.monotonic() + PATIENCE
        while not heard and time.monotonic() < due:
            rclpy.spin_once(self.node, timeout_sec=0.1)
        self.node.destroy_subscription(subscription)


def join(changes: list[str]) -> None:
    """A process of its own that sets a parameter, as `ros2 param set` does."""
    subprocess.run([sys.executable, '-c', JOINER, *changes], check=True)


def kinds(client: Client) -> dict[str, Iterator[Callable[[], None]]]:
    """Endless requests of each kind."""
    laws = [*LAWS, 's_fotsmc']
    gains = [
        {'s_fotsmc__G': 12.0},
        {'s_fotsmc__G': 10.0},
        {'smc__z': 19.0},
        {'smc__z': 20.0},
    ]
    return {
        'nothing': itertools.repeat(lambda: None),
        'switches of the law': (
            lambda law=law: client.set(law=law)  # type: ignore[misc]
            for law in itertools.cycle(laws)
        ),
        'new gains': (
            lambda one=one: client.set(**one)  # type: ignore[misc]
            for one in itertools.cycle(gains)
        ),
        'preset': (
            lambda one=one: client.set(**one)  # type: ignore[misc]
            for one in itertools.cycle(({'s_fotsmc__G': 12.0}, {'preset': 'paper'}))
        ),
        'all parameters read': itertools.repeat(client.dump),
        'late subscribers': itertools.repeat(client.listen),
        'processes that join and switch': (
            lambda law=law: join([f'law={law}'])  # type: ignore[misc]
            for law in itertools.cycle(('smc', 's_fotsmc'))
        ),
    }


def measure(given: argparse.Namespace, bag: Path) -> tuple[list[Phase], list[Any]]:
    """Run the loop with all phases."""
    words = ['--duration', str(given.seconds * 20 + 120), '--out', str(bag)]
    for pair in given.assignments:
        words += ['--set', pair]
    run = subprocess.Popen([*RUN, *words], stdout=subprocess.DEVNULL)
    phases = []
    try:
        while not any(file.stat().st_size > 300_000 for file in bag.glob('*.mcap')):
            if run.poll() is not None:
                raise RuntimeError('the run ended at once')
            time.sleep(0.1)
        client = Client()
        client.rest(given.settle)
        for name, requests in kinds(client).items():
            if given.only and name not in ('nothing', *given.only):
                continue
            count, begin, answers = 0, time.time_ns(), []
            due = time.monotonic()
            while time.time_ns() - begin < given.seconds * NANOSECONDS:
                asked = time.monotonic()
                next(requests)()
                answers.append(time.monotonic() - asked)
                count += 1
                due = max(due + given.seconds / given.requests, time.monotonic() - 1.0)
                client.rest(due - time.monotonic())
            phases.append(Phase(name, begin, time.time_ns(), count))
            print(
                f'... {name}: {count} requests, answered in {1e3 * np.median(answers):.1f} ms '
                f'({1e3 * max(answers):.1f})',
                flush=True,
            )
            client.rest(1.5)
            client.set(law='s_fotsmc')
        rclpy.shutdown()
    finally:
        run.send_signal(signal.SIGINT)
        run.wait()
    return phases, client.callbacks


def evaluate(
    bag: Path, phases: list[Phase], callbacks: list[Any], worst: int
) -> dict[str, dict[str, Any]]:
    """Figures of each phase."""
    log, past = run_log.read(bag), history.read(bag)
    period = round(log.config['period'] * NANOSECONDS)
    sent = np.array([at for at, _ in messages(bag, f'/{topics.COMMANDS.name}')])
    answered = np.flatnonzero(~np.isnan(log.answer).any(axis=1))
    steps = np.abs(np.diff(log.answer[answered], axis=0))
    own = own_steps(log, past, answered)
    ramp = np.asarray(log.config['safety.ramp_rate']) * log.config['period']
    beyond = (steps - np.broadcast_to(ramp, steps.shape) - own).max(axis=1)
    heard = log.heard[answered[1:]]
    rows = {}
    for phase in phases:
        gaps = np.diff(sent[(sent >= phase.begin) & (sent < phase.end)]) / period
        inside = (heard >= phase.begin) & (heard < phase.end)
        rows[phase.name] = {
            'requests': phase.requests,
            'gaps above 2': int((gaps > 2.0).sum()),
            'gaps above 3': int((gaps > 3.0).sum()),
            'p99.9': float(np.percentile(gaps, 99.9)),
            'longest gap': float(gaps.max()),
            'largest step': float(steps[inside].max()),
            'beyond': float(beyond[inside].max()),
            'callbacks': sorted(
                (
                    each
                    for each in callbacks
                    if 0 < each[0] - phase.begin < phase.end - phase.begin + NANOSECONDS
                ),
                key=lambda each: -each[2],
            )[:worst],
        }
    faults = [each.fault_text for each in past.statuses if each.fault != NO_FAULT]
    print(f'faults: {", ".join(faults) or "none"}')
    return rows


def own_steps(log: Any, past: Any, answered: np.ndarray) -> np.ndarray:
    """The largest change that any law that ran asks for itself at each sample [N m]."""
    ran = {status.law for status in past.statuses} | {log.law}
    largest = np.zeros((len(answered) - 1, len(log.joints)))
    for law in ran & set(LAWS):
        configuration = configure(config.changed(log.config, {'law': law}))
        demanded = replayed.instead(log, past, configuration).torque[answered]
        np.fmax(largest, np.abs(np.diff(demanded, axis=0)), out=largest)
    return largest


def messages(bag: Path, topic: str) -> Iterator[tuple[int, bytes]]:
    """Log time [ns] and bytes of the messages of a topic."""
    for file in bag.glob('*.mcap'):
        with file.open('rb') as stream:
            for _, _, message in make_reader(stream).iter_messages(topics=[topic]):
                yield message.log_time, message.data


def arguments() -> argparse.Namespace:
    """What is to be measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add('--seconds', type=float, default=15.0, metavar='T', help='of each phase, default 15')
    add('--requests', type=int, default=60, metavar='N', help='in each phase, default 60')
    add('--settle', type=float, default=2.0, metavar='T', help='before the first phase [s]')
    add('--only', action='append', metavar='PHASE', help='this phase, and nothing; repeatable')
    add('--busy', type=int, default=0, metavar='N', help='busy processes per core beside it')
    add('--worst', type=int, default=3, metavar='N', help='longest callbacks shown, default 3')
    add('--set', action='append', default=[], dest='assignments', metavar='KEY=VALUE')
    add('--bag', type=Path, metavar='DIRECTORY', help='keep the bag there')
    return parser.parse_args()


def main() -> None:
    """Measure and print."""
    given = arguments()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with tempfile.TemporaryDirectory() as directory, busy(given.busy):
        bag = given.bag or Path(directory) / 'bag'
        rows = evaluate(bag, *measure(given, bag), given.worst)
    print(
        f'{"phase":<32}{"requests":>9}{"gaps > 2":>10}{"> 3":>6}{"p99.9":>8}{"longest":>9}'
        f'{"step":>8}{"beyond":>8}   (gaps in periods, steps in N m)'
    )
    for name, one in rows.items():
        print(
            f'{name:<32}{one["requests"]:>9}{one["gaps above 2"]:>10}{one["gaps above 3"]:>6}'
            f'{one["p99.9"]:>8.2f}{one["longest gap"]:>9.2f}{one["largest step"]:>8.3f}'
            f'{one["beyond"]:>8.3f}'
        )
        for _, what, length in one['callbacks']:
            print(f'    {length:.3f} ms  {what}')


if __name__ == '__main__':
    main()
