"""The life of a node: the first line of a log, the order in which it begins, how it waits."""

import gc
import json
import logging
import subprocess
import sys

import pytest
from rclpy.executors import SingleThreadedExecutor

from parallel_robot_model.nodes import life_cycle
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode

pytest_plugins = ['ros_fixtures']

LOOKS = """
import inspect, sys
import rclpy.logging
from parallel_robot_model.nodes import life_cycle

if sys.argv[1] == 'prepared':
    life_cycle.prepare_to_log()
looks, look = [], inspect.getabsfile
inspect.getabsfile = lambda *given: looks.append(given) or look(*given)
rclpy.logging.get_logger('node').info('a line')
print(len(looks))
"""
LEVELS = """
import json, logging, sys
from parallel_robot_model.nodes import life_cycle

life_cycle.log_to_ros()
for name, level in json.loads(sys.argv[1]):
    logging.getLogger(f'parallel_robot.{name}').log(level, 'of level %d', level)
"""


@pytest.mark.parametrize(('before', 'least', 'most'), [('prepared', 0, 20), ('not', 100, 9999)])
def test_the_first_line_of_a_log_looks_at_no_module(before, least, most):
    """At 1 kHz there is no time for a thousand of them; the second case shows that they count."""
    words = [sys.executable, '-c', LOOKS, before]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    assert 'a line' in told.stderr
    assert least <= int(told.stdout) <= most


def test_a_log_record_of_python_keeps_its_level():
    records = [
        ('a', logging.INFO),
        ('a', logging.WARNING),  # the same logger with another level
        ('b', logging.ERROR),
        ('b', logging.CRITICAL),
        ('c', 35),  # between warning and error
        ('c', 70),
        ('c', logging.DEBUG),  # left out
    ]
    words = [sys.executable, '-c', LEVELS, json.dumps(records)]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    lines = [line.split() for line in told.stderr.splitlines()]
    assert [(words[0], words[2], words[-1]) for words in lines] == [
        ('[INFO]', '[parallel_robot.a]:', '20'),
        ('[WARN]', '[parallel_robot.a]:', '30'),
        ('[ERROR]', '[parallel_robot.b]:', '40'),
        ('[FATAL]', '[parallel_robot.b]:', '50'),
        ('[WARN]', '[parallel_robot.c]:', '35'),
        ('[FATAL]', '[parallel_robot.c]:', '70'),
    ]


def test_what_keeps_time_begins_when_all_is_prepared(domain, handlers):
    """A collection of all garbage stops a thread of 1 kHz for 40 ms."""

    class Node(SuiteNode):
        def begin(self):
            frozen.append(gc.get_freeze_count())
            self.finish()

    frozen = []
    assert run_node(lambda: Node('node')) == 0
    assert frozen[0] > 0


def test_a_node_that_waits_for_its_end_collects_nothing(domain, handlers, monkeypatch):
    class Executor(SingleThreadedExecutor):
        def spin_until_future_complete(self, future, timeout_sec=None):
            super().spin_until_future_complete(future, 1e-3)
            callbacks.append(len(future._callbacks))
            if len(callbacks) == 5:
                self.get_nodes()[0].finish()

    callbacks = []
    monkeypatch.setattr(life_cycle, 'EventsExecutor', Executor)
    assert run_node(lambda: SuiteNode('node')) == 0
    assert len(callbacks) == 5 and callbacks == sorted(callbacks, reverse=True)  # none is added
