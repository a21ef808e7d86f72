"""Nodes in processes of their own or in the test's, in a ROS domain that no other test has."""

import gc
import os
import select
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
from warm_process import WarmProcess, children

from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_model.processes.child_process import command

ROOT = Path(__file__).parents[1]
PATIENCE = 100.0  # s; what takes so long never comes
RECENT = 200  # messages; what else came while a test did not listen is old
PERIOD = 0.005  # s
STATE_TIMEOUT = 2.0  # s, of tests of this fault; else a machine that stands still is none
DAMPING = 10.0  # N m s/rad
SLOW_LOOP = [  # parameters of a loop in real time on a machine that is shared
    f'period:={PERIOD}',
    'safety.ramp_rate:=[200, 200, 200]',
    'safety.state_timeout:=60.0',
    'safety.reference_timeout:=60.0',
    # Stable when commands come late, and exact without friction.
    'law:=computed_torque',
    'computed_torque.Kp:=25',
    'computed_torque.Kd:=10',
    'friction.viscous:=[0, 0, 0]',
    'friction.coulomb:=[0, 0, 0]',
    f'safety.damping:=[{DAMPING}, {DAMPING}, {DAMPING}]',
]


def until(condition, step=lambda: time.sleep(0.02)):
    """Wait for a condition and return its value."""
    deadline = time.monotonic() + PATIENCE
    while not (value := condition()):
        assert time.monotonic() < deadline, 'waited in vain'
        step()
    return value


class Child(NamedTuple):
    """A child of a process under test, held by a descriptor: its pid cannot become another's."""

    pid: int
    descriptor: int

    def ended(self, seconds=0.0):
        return bool(select.select([self.descriptor], [], [], seconds)[0])

    def kill(self):
        if not self.ended():
            signal.pidfd_send_signal(self.descriptor, signal.SIGKILL)

    @contextmanager
    def paused(self):
        """Stopped meanwhile: a motion in lockstep with it stands still."""
        signal.pidfd_send_signal(self.descriptor, signal.SIGSTOP)
        try:
            yield
        finally:
            signal.pidfd_send_signal(self.descriptor, signal.SIGCONT)


class Process:
    """A module of the suite that runs in a process of its own.

    It is forked from a warm parent; if `fresh`, it has an interpreter of its own, as users start
    it, which costs two seconds.
    """

    def __init__(self, words, folder, environment, fresh=False):
        module, *words = map(str, words)
        self._errors = (folder / f'stderr_{time.monotonic_ns()}').open('w+b')
        self._output = (folder / f'stdout_{time.monotonic_ns()}').open('w+b')
        environment = {**os.environ, 'PYTHONPATH': str(ROOT), **environment}
        if fresh:
            files = {'stdout': self._output, 'stderr': self._errors}
            self._popen = subprocess.Popen(
                command(module, *words), cwd=folder, env=environment, **files
            )
        else:
            files = self._output.name, self._errors.name
            self._popen = WarmProcess(module, words, folder, environment, files)
        self._children = {}

    @property
    def pid(self):
        return self._popen.pid

    @property
    def running(self):
        return self._popen.poll() is None

    @property
    def stderr(self):
        self._errors.seek(0)
        return self._errors.read().decode()

    @property
    def stdout(self):
        self._output.seek(0)
        return self._output.read().decode()

    @property
    def memory(self):
        """What it has in memory [bytes]."""
        pages = Path(f'/proc/{self.pid}/statm').read_text().split()[1]
        return int(pages) * os.sysconf('SC_PAGE_SIZE')

    def wait(self):
        return self._popen.wait(PATIENCE)

    def until(self, condition):
        """Wait for a condition while the process runs."""
        until(lambda: not self.running or condition())
        assert self.running, self.stderr

    def signal(self, number):
        """Send a signal."""
        self._popen.send_signal(number)

    def end(self, *signals):
        """Send signals and return the exit code."""
        for number in signals:
            self.signal(number)
        return self.wait()

    def children(self):
        """Children by the module that they run."""
        for module, pid in children(self.pid).items():
            if module not in self._children:
                with suppress(ProcessLookupError):  # it has just ended
                    self._children[module] = Child(pid, os.pidfd_open(pid))
        return self._children

    def clean(self):
        if self.running:
            self.children()
            self._popen.kill()
        self.wait()
        for child in self._children.values():
            child.kill()
            os.close(child.descriptor)
        self._errors.close()
        self._output.close()


class Peer:
    """A node in the process of the test."""

    def __init__(self):
        self._context = Context()
        self._context.init()
        self.node = rclpy.create_node('peer', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._clients = {}  # by service

    def until(self, condition):
        return until(condition, self.spin)

    def spin(self, seconds=0.05):
        self._executor.spin_once(timeout_sec=seconds)

    def listen(self, topic, depth=None):
        """List that grows by what is published, or by what of it is recent."""
        heard = []
        kind, profile = message_class(topic.type), qos_of(topic)
        profile.depth = min(profile.depth, depth or profile.depth)
        self.node.create_subscription(kind, topic.name, heard.append, profile)
        return heard

    def publisher(self, topic):
        """Publisher that has its subscriber."""
        publisher = self.node.create_publisher(
            message_class(topic.type), topic.name, qos_of(topic)
        )
        self.until(publisher.get_subscription_count)
        return publisher

    def call(self, kind, name, request, server):
        """Answer of a service of a process; None when the process ends instead."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        self.until(lambda: client.service_is_ready() or not server.running)
        future = client.call_async(request)
        self.until(lambda: future.done() or not server.running)
        return future.result() if future.done() else None

    def meet(self, name, server):
        """Wait until a node knows all that subscribes here: an answer comes after these news."""
        assert self.call(Trigger, f'{name}/ready', Trigger.Request(), server), server.stderr

    def see(self, *names):
        """Wait until nodes are visible, by their full names."""
        seen = self.node.get_node_names_and_namespaces
        self.until(lambda: set(names) <= {f'{ns.rstrip("/")}/{name}' for name, ns in seen()})

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture(scope='session')
def compiled():
    """Kernels on disk, so that a node starts within PATIENCE."""
    import warm_parent  # noqa: F401


@pytest.fixture
def launch(tmp_path, compiled):
    """Start a module with its words in `tmp_path`; nothing outlives the test."""
    with ExitStack() as stack:

        def start(*words, fresh=False, **environment):
            process = Process(words, tmp_path, environment, fresh)
            stack.callback(process.clean)
            return process

        yield start


@pytest.fixture
def domain(monkeypatch):
    """Environment with a ROS domain that no other test has; this process is in it too."""
    with domain_id() as number:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(number))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        yield number


@pytest.fixture
def peer(domain):
    """A node of the test's own in that domain."""
    peer = Peer()
    yield peer
    peer.close()


class Sink:
    """Publisher that keeps what it is given."""

    def __init__(self):
        self.data = []

    def publish(self, data):
        self.data.append(data)


@pytest.fixture(params=['wall', 'lockstep'])
def node(request, domain, monkeypatch):
    """Make a node of a class in this process; what it publishes on a topic goes into a list.

    A parameter is the time mode, and perhaps a scenario after a space.
    """
    monkeypatch.setattr('parallel_robot_control.controller_node.LAST_WORD', 0.0)  # nobody listens
    made = []
    mode, _, scenario = request.param.partition(' ')
    words = ['-p', f'time_mode:={mode}', '--log-level', 'fatal']
    words += ['-p', f'scenario:={scenario or "paper_circle"}']
    words += ['-p', 'use_sim_time:=true']  # the clock stands at zero: no stamp is too old
    rclpy.init(args=['--ros-args', *words])

    def make(kind, output):
        sink = Sink()

        class Node(kind):
            def publisher(self, topic, essential=True):
                publisher = super().publisher(topic, essential)
                return sink if topic == output else publisher

        made.append(Node())
        return made[-1], sink.data

    yield make
    for one in made:
        one.close()
        one.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def handlers(monkeypatch):
    """What this process does at signals, as it was, after the test; no words for the node."""
    monkeypatch.setattr(sys, 'argv', ['node'])
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    gc.unfreeze()
    yield
    gc.unfreeze()
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
