"""The empty twin of the benchmark: it carries messages as long as the suite's to a bag."""

import argparse
import time

import pytest
import rclpy
from bags import content
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from ros_fixtures import ROOT, until

from parallel_robot.cli.command_line import main
from parallel_robot_model.messages import topics

pytest_plugins = ['ros_fixtures']


@pytest.fixture
def benchmarks(monkeypatch):
    """The folder on the path; the environment is as before at the end."""
    monkeypatch.setenv('PYTHONPATH', '')
    monkeypatch.syspath_prepend(ROOT / 'benchmarks')


def test_messages_are_as_long_as_the_suites(benchmarks, tmp_path):
    from empty_node import BYTES

    out = tmp_path / 'bag'
    assert main(['simulate', 'paper_circle', '--duration', '0.1', '--out', str(out)]) == 0
    (file,) = out.glob('*.mcap')
    recorded = content(file)
    assert recorded.keys() == {topic.name for topic in topics.RECORDED}
    for topic in topics.RECORDED:
        lengths = [len(data) for _, data in recorded[topic.name]]
        assert set(lengths[-1:]) == {len(BYTES[topic])}, topic.name


def test_all_messages_come_to_the_bag(benchmarks, domain, tmp_path):
    from empty_graph import ROLES
    from empty_node import BYTES
    from graphs import START_ORDER, subscribers

    file = tmp_path / 'bag.mcap'
    wanted = subscribers(lockstep=False, recorded=True)
    given = argparse.Namespace(lockstep=False, samples=10**6, bag=file, subscribers=wanted)
    rclpy.init(args=[])
    executor, never = EventsExecutor(), Future()
    nodes = [ROLES[role](given) for role in START_ORDER]
    try:
        until(lambda: all(node.matched() for node in nodes))
        for node in nodes:
            executor.add_node(node)
            node.begin(time.time_ns())
        until(
            lambda: file.stat().st_size,  # a chunk
            lambda: executor.spin_until_future_complete(never, timeout_sec=0.05),
        )
    finally:
        for node in nodes:
            node.close()
            executor.remove_node(node)
            node.destroy_node()
        rclpy.try_shutdown()
    recorded = content(file)
    for topic in topics.RECORDED:
        assert {data for _, data in recorded[topic.name]} == {BYTES[topic]}, topic.name
