"""Several robots in one ROS domain, told apart by namespace."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterEvent
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from parallel_robot.bags.writing.ros_topics import ParameterWatch
from parallel_robot.cli.command_line import main
from parallel_robot.cli.ros_session import Session
from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_model.messages.topics import full
from parallel_robot_model.nodes.background import STATE_INDEX
from parallel_robot_model.processes import node_processes as processes

pytest_plugins = ['ros_fixtures']

GOOD = {
    '': '',
    '/': '',
    'left': '/left',
    '/left': '/left',
    'cell_1/Left': '/cell_1/Left',
    '_hidden': '/_hidden',
    'a' * 100: '/' + 'a' * 100,
}


@pytest.mark.parametrize('name', GOOD)
def test_ros_takes_the_name_that_is_given(name):
    assert full(name) == GOOD[name]
    context = Context()
    context.init(['--ros-args', '-r', f'__ns:={full(name)}'] if full(name) else [])
    node = Node('controller', context=context, enable_rosout=False)
    try:
        assert node.get_namespace() == (full(name) or '/')
    finally:
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.parametrize(
    'name', ['9x', 'a-b', 'a b', 'a/', '//a', 'a//b', 'a__b', 'ä', 'a\n', '~', '..', 'a' * 101]
)
def test_a_wrong_name_costs_one_line(name, capsys):
    with pytest.raises(InputError, match='namespace must be'):
        full(name)
    for words in (['run', 'paper_circle', '--out', 'never'], ['top']):
        assert main([*words, '--namespace', name]) == 2
        out, err = capsys.readouterr()
        assert out == '' and repr(name) in err and err.count('\n') == 1


def test_one_run_a_namespace(monkeypatch, tmp_path):
    monkeypatch.setattr(processes.tempfile, 'tempdir', str(tmp_path))
    with processes.domain_lock(), processes.domain_lock('/a'), processes.domain_lock('/a/b'):
        for name, text in {'': 'another run uses ROS domain', '/a': 'namespace /a of ROS'}.items():
            with pytest.raises(RunError, match=text), processes.domain_lock(name):
                pass
    with processes.domain_lock('/a'):
        pass


def test_progress_is_that_of_the_own_plant():
    session = Session(['plant'], lambda: None, '/left')

    def report(node, state):
        values = [KeyValue(key=STATE_INDEX, value=state)]
        status = DiagnosticStatus(hardware_id=node, values=values)
        session.take_diagnostics(DiagnosticArray(status=[status]))

    report('/right/plant', '7')
    report('/plant', '8')
    report('/left/controller', '9')
    assert session.state == -1
    report('/left/plant', '5')
    assert session.state == 5


def test_changes_of_another_robot_are_not_noted(peer):
    noted = []
    watch = ParameterWatch(peer.node, lambda *_: None, lambda *change: noted.append(change))
    watch.ask(['/left/controller'])
    publisher = peer.node.create_publisher(
        ParameterEvent, '/parameter_events', QoSProfile(depth=9)
    )
    peer.until(lambda: publisher.get_subscription_count() >= 1)
    law = Parameter('law', value='smc').to_parameter_msg()
    for node in ('/right/controller', '/controller', '/left/controller'):
        publisher.publish(ParameterEvent(node=node, changed_parameters=[law]))
    peer.until(lambda: noted)
    assert noted == [('/left/controller', {'law': 'smc'})]
