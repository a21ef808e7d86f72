"""The table of who subscribes to what, against the nodes themselves."""

from importlib import import_module

import pytest
import rclpy
from ros_fixtures import until

from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import OUTPUTS, subscribers, subscriptions
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']


@pytest.fixture
def nodes(mode, domain, tmp_path):
    """The nodes of a run, in this process; they wait for their start."""
    words = [f'time_mode:={mode}', 'start_stamp:=-1', f'recorder.out:={tmp_path / "bag"}']
    given = [word for parameter in words for word in ('-p', parameter)]
    rclpy.init(args=['--ros-args', *given, '--log-level', 'fatal'])
    made = {}
    try:
        for name, module in MODULES.items():
            made[name] = getattr(import_module(module), f'{name.title()}Node')()
        yield made
    finally:
        for node in made.values():
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_the_nodes_subscribe_to_what_the_table_says(mode, nodes):
    lockstep = mode == 'lockstep'
    table = subscriptions(MODULES, lockstep)
    outputs = {*topics.RECORDED, topics.MARKERS, topics.CLOCK, *OUTPUTS.values()}
    wanted = {topic: table[topic] for topic in outputs}
    counted = {}

    def agree():
        counted.update((topic, nodes['plant'].count_subscribers(topic.name)) for topic in outputs)
        return counted == wanted

    until(agree)
    assert subscribers(MODULES, lockstep) == {
        name: counted[topic] for name, topic in OUTPUTS.items()
    }


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_the_nodes_publish_what_the_table_says(mode, nodes):
    for name, topic in OUTPUTS.items():
        node = nodes[name]
        until(lambda: node.get_publishers_info_by_topic(topic.name))  # noqa: B023
        (info,) = node.get_publishers_info_by_topic(topic.name)
        assert info.node_name == name


def test_a_run_in_lockstep_has_one_subscriber_more():
    wall, lockstep = (subscribers(MODULES, lockstep) for lockstep in (False, True))
    assert wall == {'plant': 2, 'trajectory': 2, 'controller': 2}
    assert lockstep == {'plant': 3, 'trajectory': 2, 'controller': 2}
