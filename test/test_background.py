"""What takes long is done beside the loop of a node, and takes effect within it."""

import sys
import threading

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode

pytest_plugins = ['ros_fixtures']
LONG = 60.0  # s, for a loop that stands still


class Slow(SuiteNode):
    """A node that, for a change and for its diagnostics, waits until its loop has turned."""

    def __init__(self):
        super().__init__('node')
        self.turned, self.result, self.where = threading.Event(), None, None
        self.told = []  # whether the loop turned while the diagnostics waited
        self._client = self.create_client(SetParameters, 'node/set_parameters')
        self.create_timer(0.005, self.turn)

    def turn(self):
        self.turned.set()
        if self._client.service_is_ready() and not self.result:
            parameter = Parameter('period', value=0.001).to_parameter_msg()
            request = SetParameters.Request(parameters=[parameter])
            self.result = self._client.call_async(request)
        if self.told and self.result and self.result.done():
            self.finish()

    def is_settable(self, key):
        return super().is_settable(key) or key == 'period'

    def wait(self):
        self.turned.clear()
        return self.turned.wait(LONG)

    def prepare_change(self, changes):
        if not self.wait():
            raise InputError('the loop stood still')
        return changes, self.act

    def act(self):
        self.where = threading.current_thread()

    def diagnose(self):
        self.told.append(self.wait())
        return {}


@pytest.mark.parametrize('executor', ['events', 'single'])
def test_the_loop_goes_on_while_a_change_is_prepared(executor, domain, handlers, monkeypatch):
    made = []

    def make():
        made.append(Slow())
        return made[0]

    monkeypatch.setattr(sys, 'argv', ['node', '--ros-args', '-p', f'executor:={executor}'])
    assert run_node(make) == 0
    answer = made[0].result.result().results[0]
    assert answer.successful, answer.reason
    assert made[0].where is threading.main_thread()
    assert all(made[0].told)
