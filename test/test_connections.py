"""What a node subscribes to, and when its partners are there."""

from types import SimpleNamespace

import pytest
from rclpy.qos import ReliabilityPolicy

from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_sim.plant_node import PlantNode

pytest_plugins = ['ros_fixtures']


def test_a_lost_message_holds_up_no_newer_one_but_in_lockstep(node):
    """Nor does a node that was killed: nobody waits for what it has not acknowledged."""
    controller, _ = node(ControllerNode, topics.COMMANDS)
    plant, _ = node(PlantNode, topics.JOINT_STATES)
    lockstep = controller.loop.lockstep
    wanted = ReliabilityPolicy.RELIABLE if lockstep else ReliabilityPolicy.BEST_EFFORT
    for reader, topic in (
        (controller, 'joint_states'),
        (controller, 'reference'),
        (plant, 'effort_controller/commands'),
    ):
        (info,) = reader.get_subscriptions_info_by_topic(topic)
        assert info.qos_profile.reliability == wanted


class Relay(SuiteNode):
    """Has one input and two outputs, of which one is essential."""

    def __init__(self):
        super().__init__('relay')
        self.told = []
        self.publisher(topics.POSE, essential=False)
        self.publisher(topics.COMMANDS)
        self.subscribe(topics.JOINT_STATES, print)

    def warn(self, text):
        if 'two publishers' in text:
            self.told.append(text)


@pytest.mark.parametrize('node', ['wall'], indirect=True)
def test_a_node_says_what_it_waits_for(node, peer):
    relay, _ = node(Relay, None)
    assert relay.missing() == 'no publisher of joint_states'
    peer.publisher(topics.JOINT_STATES)
    peer.until(lambda: not relay.missing().startswith('no publisher'))
    assert relay.missing() == '/effort_controller/commands has 0 of 1 subscribers'
    peer.listen(topics.COMMANDS)
    peer.until(lambda: not relay.missing())


@pytest.mark.parametrize('node', ['wall'], indirect=True)
def test_a_stranger_is_told_again_when_its_name_becomes_known(node, peer, monkeypatch):
    """ROS knows a publisher some time before it knows the name of its node."""
    relay, _ = node(Relay, None)
    for _ in range(2):
        peer.publisher(topics.JOINT_STATES)
    name = '/joint_states'
    peer.until(lambda: relay.count_publishers(name) == 2)
    heard_of = SimpleNamespace(node_namespace='/', node_name='_NODE_NAME_UNKNOWN_')
    with monkeypatch.context() as patch:
        patch.setattr(relay, 'get_publishers_info_by_topic', lambda _: [heard_of])
        relay._on_unknown_publisher(topics.JOINT_STATES, several=False)
        relay._publish_diagnostics()
    (line,) = relay.told
    assert line.endswith(f'{name} has 1 publisher: one that is not known yet')
    known = f'{name} has 2 publishers: /peer, /peer'
    peer.until(lambda: relay._publish_diagnostics() or relay.told[-1].endswith(known))
    count = len(relay.told)
    relay._publish_diagnostics()
    assert len(relay.told) == count


@pytest.mark.parametrize('node', ['wall'], indirect=True)
def test_a_publisher_that_was_restarted_is_not_called_two(node, peer):
    """Messages of both may be heard when ROS knows one alone: the line does not contradict it."""
    relay, _ = node(Relay, None)
    peer.publisher(topics.JOINT_STATES)
    peer.until(lambda: relay.count_publishers('/joint_states') == 1)
    relay._on_unknown_publisher(topics.JOINT_STATES, several=False)
    relay._publish_diagnostics()
    assert relay.told[0].startswith(
        'messages of two publishers, one ended or not known yet, those'
    )


@pytest.mark.parametrize('node', ['wall'], indirect=True)
def test_a_publisher_that_was_killed_is_not_called_one_that_is_used(node, monkeypatch):
    """ROS counts it for 20 s, under the name of the one that was started in its place."""
    relay, _ = node(Relay, None)
    named = SimpleNamespace(node_namespace='/', node_name='joint_state_broadcaster')
    monkeypatch.setattr(relay, 'get_publishers_info_by_topic', lambda _: [named] * 2)
    monkeypatch.setattr(relay._connections, 'silence', lambda _: 2.34)
    relay._on_unknown_publisher(topics.JOINT_STATES, several=False)
    relay._publish_diagnostics()
    assert relay.told == [
        'messages of two publishers, one silent for 2.3 s: if it was killed, it counts for 20 s, '
        'the other is used: /joint_states has 2 publishers: /joint_state_broadcaster, '
        '/joint_state_broadcaster'
    ]
