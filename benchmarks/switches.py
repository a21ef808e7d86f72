"""What holds up a loop that runs: changes of law and gains, parameter requests, late subscribers.

One run, in phases that take turns: nothing, and each kind of request. Of each: the pauses between
commands, the steps of the torque beyond the ramp and what a law asks for itself, and the longest
callbacks.

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
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from parallel_robot.analysis.replay import replayed
from parallel_robot.bags.run import recording
from parallel_robot_control.configuration import configure
from parallel_robot_control.laws import LAWS
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.ros_client import Services, messages_of, reported

PATIENCE = 30.0  # s
SETTLE = 1.5  # s, before each phase
BEGUN = 300_000  # bytes of a bag whose loop runs
LONGEST = 'longest callback [ms]'  # key of the diagnostics
COLUMNS = ('requests', 'answer', 'above 2', 'above 3', 'p99.9', 'longest', 'step', 'beyond')
LEGEND = """requests and the median of their answers [ms]; pauses between commands: above 2 and 3
periods (each a minute), 99.9 %, longest [periods]; largest step of the torque, and what it has
beyond the ramp and the largest step of any law itself [N m]; below, the longest callbacks of all
nodes"""


class Phase(NamedTuple):
    """What was asked of the loop within spans of time."""

    name: str  # what was asked
    spans: list[tuple[int, int]]  # begin and end of each span [ns]
    answers: list[float]  # how long each answer took [s]

    def inside(self, times: np.ndarray) -> np.ndarray:
        """Which times [ns] lie within the spans, same shape."""
        return np.any([(times >= begin) & (times < end) for begin, end in self.spans], axis=0)


class Client:
    """Asks the controller, as `ros2 param` does, from one process."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node = rclpy.create_node('benchmark_switches')
        self.callbacks: list[tuple[int, str, float]] = []
        self._services = Services(self.node)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 100)

    def _take(self, array: DiagnosticArray) -> None:
        """Note the longest callback of a second of a node."""
        for status in array.status:
            values = reported(status)
            if LONGEST in values:
                length, _, name = values[LONGEST].partition(' ')
                what = f'{status.hardware_id} {name}'
                self.callbacks.append((time.time_ns(), what, float(length)))

    def rest(self, seconds: float) -> None:
        """Wait, while diagnostics come in."""
        due = time.monotonic() + seconds
        while (left := due - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=left)

    def call(self, name: str, **fields: Any) -> Any:
        """Answer of a service of the controller."""
        answer = self._services.call(f'controller/{name}', PATIENCE, PATIENCE, **fields)
        if answer is None:
            raise RuntimeError(f'no answer of {name}')
        return answer

    def set(self, **changes: Any) -> None:
        """Set parameters; `__` stands for a point."""
        values = {key.replace('__', '.'): value for key, value in changes.items()}
        answer = self.call('set_parameters', parameters=messages_of(values))
        if not all(result.successful for result in answer.results):
            raise RuntimeError(answer.results[0].reason)

    def dump(self) -> None:
        """Ask for everything that `ros2 param dump` and `describe` ask for."""
        names = list(self.call('list_parameters').result.names)
        self.call('get_parameters', names=names)
        self.call('describe_parameters', names=names)

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
    """Run the loop: all phases in turn, several times over; returns them and what was told."""
    words = ['--duration', str(given.seconds * 20 + 120), '--out', str(bag)]
    for pair in given.assignments:
        words += ['--set', pair]
    run = subprocess.Popen([*RUN, *words], stdout=subprocess.DEVNULL)
    try:
        while not any(file.stat().st_size > BEGUN for file in bag.glob('*.mcap')):
            if run.poll() is not None:
                raise RuntimeError('the run ended at once')
            time.sleep(0.1)
        client = Client()
        requests = kinds(client)
        phases = [Phase(name, [], []) for name in requests if not given.only or name in given.only]
        client.rest(SETTLE)
        for _ in range(given.rounds):
            for phase in phases:
                ask(client, phase, requests[phase.name], given)
                client.rest(SETTLE)
                client.set(law='s_fotsmc', preset='paper')
        rclpy.shutdown()
    finally:
        run.send_signal(signal.SIGINT)
        run.wait()
    return phases, client.callbacks


def ask(client: Client, phase: Phase, requests: Any, given: argparse.Namespace) -> None:
    """Ask for some time, at a steady rate if the answers come in time."""
    count = given.requests // given.rounds
    pause = given.seconds / given.rounds / count
    begin = time.time_ns()
    for _ in range(count):
        asked = time.monotonic()
        next(requests)()
        phase.answers.append(time.monotonic() - asked)
        client.rest(pause - phase.answers[-1])
        if time.time_ns() - begin > 2 * given.seconds / given.rounds * NANOSECONDS:
            break  # new processes take seconds
    phase.spans.append((begin, time.time_ns()))


def evaluate(bag: Path, phases: list[Phase], callbacks: list[Any], worst: int) -> dict[str, Any]:
    """Figures of each phase."""
    log, past, _ = recording.read(bag)
    sent = np.array([at for at, _ in messages(bag, f'/{topics.COMMANDS.name}')])
    gaps = np.diff(sent) / NANOSECONDS / log.config['period']
    answered = np.flatnonzero(~np.isnan(log.answer).any(axis=1))
    steps = np.abs(np.diff(log.answer[answered], axis=0))
    ramp = np.asarray(log.config['safety.ramp_rate']) * log.config['period']
    beyond = steps - ramp - own_steps(log, past, answered)
    told = np.array([at for at, _, _ in callbacks])
    rows = {}
    for phase in phases:
        some, during = gaps[phase.inside(sent[1:])], phase.inside(log.heard[answered[1:]])
        length = sum(end - begin for begin, end in phase.spans) / NANOSECONDS
        rows[phase.name] = {
            'requests': len(phase.answers),
            'answer': 1e3 * float(np.median(phase.answers)),
            'above 2': 60.0 * int((some > 2.0).sum()) / length,
            'above 3': 60.0 * int((some > 3.0).sum()) / length,
            'p99.9': float(np.percentile(some, 99.9)),
            'longest': float(some.max()),
            'step': float(steps[during].max()),
            'beyond': float(beyond[during].max()),
            'callbacks': sorted(
                itertools.compress(callbacks, phase.inside(told)), key=lambda each: -each[2]
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
    add('--rounds', type=int, default=3, metavar='N', help='parts of each phase, default 3')
    add('--only', action='append', metavar='PHASE', help='a phase to be run; repeatable')
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
    print(f'{"":<32}' + ''.join(f'{column:>10}' for column in COLUMNS))
    for name, one in rows.items():
        print(f'{name:<32}' + ''.join(f'{one[column]:>10.4g}' for column in COLUMNS))
        for _, what, length in one['callbacks']:
            print(f'    {length:.3f} ms  {what}')
    print(LEGEND)


if __name__ == '__main__':
    main()
