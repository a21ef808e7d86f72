"""Messages of a gripper on the topic of our robot are somebody else's."""

import pytest

from parallel_robot_model.messages import topics
from parallel_robot_model.messages.layouts import OWN
from parallel_robot_model.nodes.joint_reader import OurJoints

OURS = ('joint1', 'joint2', 'joint3')


def message(topic, joints, stamp=10**9):
    return OWN[topic.type](joints).encode(stamp)


@pytest.mark.parametrize('topic', [topics.JOINT_STATES, topics.REFERENCE])
def test_messages_without_any_of_our_joints_are_of_others(topic):
    watch = OurJoints(topic, OURS)
    arm = ('joint4', 'joint5', 'joint6')  # as long as ours
    for k in range(1, 4):
        assert watch.is_foreign(message(topic, ('gripper_left',), k))
        assert not watch.is_foreign(message(topic, OURS, k))
        assert watch.is_foreign(message(topic, arm, k))
        assert not watch.is_foreign(message(topic, (*arm, 'joint1'), k))  # the reader says it
        assert not watch.is_foreign(message(topic, OURS[::-1], k))


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0' * 200, b'\xff' * 70_000])
def test_what_is_no_message_is_left_to_its_reader(data):
    assert not OurJoints(topics.JOINT_STATES, OURS).is_foreign(data)
