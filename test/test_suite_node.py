"""What all nodes share: how they read, the first line of a log, the order in which they begin."""

import functools
import gc
import subprocess
import sys
from collections import Counter

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import Trigger

from parallel_robot_base.errors import RunError
from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_ros import suite_node
from parallel_robot_ros.suite_node import SuiteNode, run_node
from parallel_robot_sim.plant_node import PlantNode

pytest_plugins = ['ros_fixtures']

LOOKS = """
import inspect, sys
import rclpy.logging
from parallel_robot_ros import suite_node

if sys.argv[1] == 'prepared':
    suite_node.prepare_to_log()
looks, look = [], inspect.getabsfile
inspect.getabsfile = lambda *given: looks.append(given) or look(*given)
rclpy.logging.get_logger('node').info('a line')
print(len(looks))
"""


@pytest.mark.parametrize(('before', 'least', 'most'), [('prepared', 0, 20), ('not', 100, 9999)])
def test_the_first_line_of_a_log_looks_at_no_module(before, least, most):
    """At 1 kHz there is no time for a thousand of them; the second case shows that they count."""
    words = [sys.executable, '-c', LOOKS, before]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    assert 'a line' in told.stderr
    assert least <= int(told.stdout) <= most


def test_what_keeps_time_begins_when_all_is_prepared(domain, handlers):
    """A collection of all garbage stops a thread of 1 kHz for 40 ms."""

    class Node(SuiteNode):
        def begin(self):
            frozen.append(gc.get_freeze_count())
            self.finish()

    frozen = []
    assert run_node(lambda: Node('node', {})) == 0
    assert frozen[0] > 0


def test_a_node_that_waits_for_its_end_collects_nothing(domain, handlers, monkeypatch):
    class Executor(SingleThreadedExecutor):
        def spin_until_future_complete(self, future, timeout_sec=None):
            super().spin_until_future_complete(future, 1e-3)
            callbacks.append(len(future._callbacks))
            if len(callbacks) == 5:
                self.get_nodes()[0].finish()

    callbacks = []
    monkeypatch.setattr(suite_node, 'EventsExecutor', Executor)
    assert run_node(lambda: SuiteNode('node', {})) == 0
    assert len(callbacks) == 5 and len(set(callbacks)) == 1


def test_a_lost_message_holds_up_no_newer_one_but_in_lockstep(node):
    """Nor does a node that was killed: nobody waits for what it has not acknowledged."""
    controller, _ = node(ControllerNode, '_commands')
    plant, _ = node(PlantNode, '_states')
    lockstep = controller.loop.lockstep
    wanted = ReliabilityPolicy.RELIABLE if lockstep else ReliabilityPolicy.BEST_EFFORT
    for reader, topic in (
        (controller, 'joint_states'),
        (controller, 'reference'),
        (plant, 'effort_controller/commands'),
    ):
        (info,) = reader.get_subscriptions_info_by_topic(topic)
        assert info.qos_profile.reliability == wanted


@pytest.mark.parametrize('executor', ['events', 'single'])
@pytest.mark.parametrize('error', [ValueError, RunError])
def test_only_errors_that_the_suite_means_end_a_node(
    error, executor, domain, handlers, monkeypatch
):
    """Whatever a message, a request or a timer brings about, the node tells and goes on."""

    class Node(SuiteNode):
        def __init__(self):
            super().__init__('node', {})
            self.calls = Counter()
            for what in ('message', 'request'):
                setattr(self, what, functools.partial(self.raise_at, what))
            self.create_subscription(String, 'topic', self.message, 10)
            self.create_service(Trigger, 'service', self.request)
            self.create_timer(0.01, functools.partial(self.raise_at, 'timer'))
            self._publisher = self.create_publisher(String, 'topic', 10)
            self._client = self.create_client(Trigger, 'service')
            self.create_timer(0.02, self.send)

        def raise_at(self, what, *_):
            self.calls[what] += 1
            raise error(what)

        def send(self):
            self._publisher.publish(String())
            if self._client.service_is_ready():
                self._client.call_async(Trigger.Request())
            if min(self.calls[what] for what in ('message', 'request', 'timer')) > 2:
                self.finish()

    made = []

    def make():
        made.append(Node())
        return made[0]

    monkeypatch.setattr(sys, 'argv', ['node', '--ros-args', '-p', f'executor:={executor}'])
    assert run_node(make) == int(error is RunError)
    if error is ValueError:
        assert made[0].counts['unforeseen errors'] == made[0].calls.total() > 8
