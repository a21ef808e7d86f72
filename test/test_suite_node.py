"""A node of the suite survives what its callbacks raise; errors on purpose end it in order."""

import functools
import sys
from collections import Counter

import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode

pytest_plugins = ['ros_fixtures']


@pytest.mark.parametrize('executor', ['events', 'single'])
@pytest.mark.parametrize('error', [ValueError, RunError])
def test_only_errors_that_the_suite_means_end_a_node(
    error, executor, domain, handlers, monkeypatch
):
    """Whatever a message, a request or a timer brings about, the node tells and goes on."""

    class Node(SuiteNode):
        def __init__(self):
            super().__init__('node')
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
