"""The node of a tool: in the domain for a while, whatever happens meanwhile."""

import os
import signal

import pytest
import rclpy

from parallel_robot_model.nodes.middleware import TRANSPORTS, tool_node

pytest_plugins = ['ros_fixtures']


def fail_in_the_domain():
    with tool_node('tool', namespace='/left') as node:
        raise RuntimeError(node.get_fully_qualified_name())


def test_it_leaves_the_domain_when_the_tool_fails(domain):
    for _ in range(2):
        with pytest.raises(RuntimeError, match='/left/tool'):
            fail_in_the_domain()
        assert not rclpy.ok()


def test_signals_and_environment_stay_as_they_are(domain):
    handler = signal.getsignal(signal.SIGINT)
    with tool_node('tool', 'udp'):
        assert signal.getsignal(signal.SIGINT) is handler
        assert TRANSPORTS not in os.environ  # processes that the tool starts choose for themselves
